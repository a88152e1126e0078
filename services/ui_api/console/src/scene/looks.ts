// Colours, materials and unit shapes that the scene shares: few, so that few programs are compiled.
import {
  BoxGeometry,
  type BufferGeometry,
  CylinderGeometry,
  DoubleSide,
  IcosahedronGeometry,
  MeshBasicMaterial,
  MeshLambertMaterial,
  OctahedronGeometry,
  TorusGeometry,
} from "three";
import { mergeGeometries } from "three/examples/jsm/utils/BufferGeometryUtils.js";
import type { Nearness } from "./hexapod";

/** Also in `scene.css`, where the legend shows them. */
export const COLOUR = {
  now: "#fbbf24",
  planned: "#7dd3fc",
  hole: "#4ade80",
  free: "#86a3bd",
  near: "#fbbf24",
  at_limit: "#ff6b6b",
  ray: "#f0abfc",
} as const;

function solid(color: string): MeshLambertMaterial {
  return new MeshLambertMaterial({ color });
}

/** Shows what lies behind it. */
function clear(color: string, opacity: number): MeshLambertMaterial {
  return new MeshLambertMaterial({ color, opacity, transparent: true, depthWrite: false, side: DoubleSide });
}

/** Not shaded: marks, not things. */
function mark(color: string, opacity = 1): MeshBasicMaterial {
  return new MeshBasicMaterial({ color, opacity, transparent: opacity < 1, depthWrite: opacity === 1 });
}

export const LOOK = {
  bone: clear("#efe3c4", 0.22),
  nail: solid("#b9c6d3"),
  bore: solid("#10161d"),
  ball: solid("#e8eef4"),
  delrin: clear("#dfe7ee", 0.34),
  metal: solid("#5d6f82"),
  screw: solid("#8c99a6"),
  housing: solid("#46535f"),
  window: clear("#9fb4c8", 0.18),
  beam: mark(COLOUR.ray, 0.07),
  ray: mark(COLOUR.ray, 0.7),
  now: mark(COLOUR.now),
  planned: mark(COLOUR.planned),
  hole: mark(COLOUR.hole),
  cone: mark(COLOUR.hole, 0.28),
  ghost: clear(COLOUR.planned, 0.3),
  /** What is not live, whatever it is. */
  stale: clear("#8b98a5", 0.4),
} as const;

/** Seen through everything: circles at the entry lie in the bore. */
function over(color: string): MeshBasicMaterial {
  return new MeshBasicMaterial({ color, transparent: true, depthTest: false });
}

export const OVER = {
  now: over(COLOUR.now),
  planned: over(COLOUR.planned),
  hole: over(COLOUR.hole),
} as const;

export const LEG: Readonly<Record<Nearness, MeshLambertMaterial>> = {
  free: solid(COLOUR.free),
  near: solid(COLOUR.near),
  at_limit: solid(COLOUR.at_limit),
};

/** Shapes of size 1; a rod lies along y from -1/2 to 1/2. */
export const SHAPE = {
  rod: new CylinderGeometry(1, 1, 1, 18),
  tube: new CylinderGeometry(1, 1, 1, 36, 1, true),
  box: new BoxGeometry(1, 1, 1),
  ball: new IcosahedronGeometry(1, 1),
  coarseBall: new OctahedronGeometry(1),
  dashes: dashes(),
} as const;

function dashes(): BufferGeometry {
  const count = 14;
  const each = Array.from({ length: count }, (_, index) =>
    new CylinderGeometry(1, 1, 0.6 / count, 8).translate(0, (index + 0.5) / count - 0.5, 0),
  );
  return mergeGeometries(each);
}

/** A circle across y. */
export function ring(radius_mm: number, thickness_mm: number): TorusGeometry {
  const torus = new TorusGeometry(radius_mm, thickness_mm, 8, 48);
  torus.rotateX(Math.PI / 2);
  return torus;
}
