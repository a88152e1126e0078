import { useMemo } from "react";
import { LatheGeometry, Vector2, Vector3 } from "three";
import { LOOK, SHAPE } from "./looks";
import type { NailPart } from "./parts";
import { Placed, Rod } from "./pieces";
import type { Seen } from "./sceneModel";

// Schematic: a shaft that widens towards the joint. Half widths at places along the nail, from its tip, in mm.
const PROFILE_FROM_TIP_MM: readonly (readonly [number, number])[] = [
  [-230, 14],
  [-90, 14.5],
  [-60, 16],
  [-30, 20],
  [0, 27],
  [18, 31],
  [32, 31],
  [42, 25],
  [48, 13],
  [50, 0.1],
];
const NAIL_SHOWN_MM = 190;

/** Bone and nail as an image showed them. */
export default function Patient({
  nail,
  seen,
  showsBone,
}: {
  nail: NailPart;
  seen: Seen;
  showsBone: boolean;
}) {
  return (
    <Placed at={seen.base_from_nail.matrix}>
      {showsBone && <Bone tip_x_mm={nail.tip_x_mm} />}
      <Rod
        from_mm={new Vector3(nail.tip_x_mm - NAIL_SHOWN_MM, 0, 0)}
        to_mm={new Vector3(nail.tip_x_mm - nail.diameter_mm / 3, 0, 0)}
        radius_mm={nail.diameter_mm / 2}
        look={LOOK.nail}
      />
      <mesh
        geometry={SHAPE.ball}
        material={LOOK.nail}
        position={[nail.tip_x_mm - nail.diameter_mm / 3, 0, 0]}
        scale={[nail.diameter_mm / 3, nail.diameter_mm / 2, nail.diameter_mm / 2]}
      />
      {nail.holes.map((hole) => {
        const middle = new Vector3(...hole.position_mm);
        const half = new Vector3(...hole.direction).multiplyScalar(nail.diameter_mm / 2 + 0.15);
        return (
          <Rod
            key={hole.id}
            from_mm={middle.clone().sub(half)}
            to_mm={middle.clone().add(half)}
            radius_mm={hole.diameter_mm / 2}
            look={LOOK.bore}
          />
        );
      })}
    </Placed>
  );
}

function Bone({ tip_x_mm }: { readonly tip_x_mm: number }) {
  const shape = useMemo(() => {
    const profile = PROFILE_FROM_TIP_MM.map(([x, half]) => new Vector2(half, x));
    const lathe = new LatheGeometry(profile, 28);
    lathe.rotateZ(-Math.PI / 2);
    return lathe;
  }, []);
  return (
    <mesh
      geometry={shape}
      material={LOOK.bone}
      position={[tip_x_mm, 0, 0]}
      scale={[1, 0.9, 1.1]}
      renderOrder={3}
    />
  );
}
