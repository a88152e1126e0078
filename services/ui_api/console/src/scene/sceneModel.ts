// What stands where, in the frame of the robot's base, which is fixed to the bone: pure.
import type { Vector3 } from "three";
import type { CaseView, LocalisationView, PlanView, RobotView } from "../api/types";
import { baseFromTop, type Leg, legsOf, topFromGuide } from "./hexapod";
import { angleBetweenDeg, type Line, offsetAcross } from "./lines";
import { poseAlong } from "./motion";
import type { GuidePart, HexapodPart, Parts, Pose } from "./parts";
import { type Point, Transform } from "./transform";
import type { AxisUncertainty } from "./uncertainty";

/** The robot in one pose, with what it carries. */
export interface Stance {
  readonly pose: Pose;
  readonly base_from_top: Transform<"base", "top">;
  readonly base_from_guide: Transform<"base", "guide">;
  readonly legs: readonly Leg[];
}

export interface SeenHole {
  readonly id: string;
  readonly diameter_mm: number;
  /** The hole's axis in the direction of drilling, through the entry point. */
  readonly axis: Line;
  readonly exit_mm: Vector3;
  readonly tilt_to_ray_deg: number;
  readonly uncertainty: AxisUncertainty | null;
}

/** What an image showed, carried to the base by where the robot stood then. */
export interface Seen {
  readonly base_from_nail: Transform<"base", "nail">;
  readonly holes: readonly SeenHole[];
  readonly base_from_camera: Transform<"base", "camera"> | null;
  readonly camera_from_ring: Transform<"camera", "ring"> | null;
}

export interface Motion {
  readonly start: Pose;
  readonly target: Pose;
  readonly pivot_mm: Point;
  readonly head_extension_mm: number;
}

export interface SceneModel {
  readonly parts: Parts;
  readonly side: string;
  readonly bone: string;
  readonly mount: string;
  readonly drill_diameter_mm: number;
  /** Null while the robot has not said where it stands. */
  readonly now: Stance | null;
  readonly planned: Stance | null;
  readonly motion: Motion | null;
  readonly seen: Seen | null;
}

export interface Sources {
  readonly caseView: Pick<
    CaseView,
    "side" | "bone" | "mount" | "head_extension_mm" | "drill_diameter_mm" | "revision"
  >;
  readonly robot: Pick<RobotView, "state"> | null;
  readonly localisation: LocalisationView | null;
  readonly plan: PlanView | null;
}

export function stanceOf(
  hexapod: HexapodPart,
  pose: Pose,
  pivot_mm: Point,
  head_extension_mm: number,
): Stance {
  const base_from_top = baseFromTop(hexapod, pose, pivot_mm);
  return {
    pose,
    base_from_top,
    base_from_guide: base_from_top.after(topFromGuide(hexapod, head_extension_mm)),
    legs: legsOf(hexapod, pose, pivot_mm),
  };
}

export function sceneModel(parts: Parts, { caseView, robot, localisation, plan }: Sources): SceneModel {
  const state = robot?.state ?? null;
  const pivot_mm = state?.pivot_mm ?? parts.hexapod.pivot_mm;
  const extension_mm = caseView.head_extension_mm;
  const motion = motionOf(plan);
  return {
    parts,
    side: caseView.side,
    bone: caseView.bone,
    mount: caseView.mount,
    drill_diameter_mm: caseView.drill_diameter_mm,
    now: state?.pose ? stanceOf(parts.hexapod, state.pose, pivot_mm, extension_mm) : null,
    planned: motion && stanceOf(parts.hexapod, motion.target, motion.pivot_mm, motion.head_extension_mm),
    motion,
    seen: localisation && seenIn(parts, localisation, caseView.revision, pivot_mm, extension_mm),
  };
}

/** The robot on its planned way: after a share of it, 0 to 1. */
export function ghostStance({ motion, parts }: SceneModel, share: number | null): Stance | null {
  if (motion === null || share === null) return null;
  const pose = poseAlong(motion.start, motion.target, share);
  return stanceOf(parts.hexapod, pose, motion.pivot_mm, motion.head_extension_mm);
}

/** The motion of a plan that still holds; one that was made already leads nowhere, and stays to be seen. */
function motionOf(plan: PlanView | null): Motion | null {
  if (plan === null || plan.validity !== "current") return null;
  const { start_pose, target_pose, pivot_mm, head_extension_mm } = plan.plan;
  return { start: start_pose, target: target_pose, pivot_mm, head_extension_mm };
}

/** Null where the image did not show the nail, was of another set-up, or found the robot nobody knows where. */
function seenIn(
  parts: Parts,
  localisation: LocalisationView,
  revision: number,
  pivot_mm: Point,
  extension_mm: number,
): Seen | null {
  const { guide_from_nail, holes, guide, camera, provenance } = localisation;
  if (!guide_from_nail || !provenance.robot_pose || provenance.case_revision !== revision) return null;
  const then = stanceOf(parts.hexapod, provenance.robot_pose, pivot_mm, extension_mm).base_from_guide;
  const camera_from_guide = guide && Transform.ofRows<"camera", "guide">(guide.camera_from_guide);
  return {
    base_from_nail: then.after(Transform.ofRows<"guide", "nail">(guide_from_nail)),
    holes: (holes ?? []).map((hole) => seenHole(parts, then, hole)),
    base_from_camera: camera_from_guide && then.after(camera_from_guide.inverse()),
    camera_from_ring: camera && Transform.ofRows<"camera", "ring">(camera.camera_from_ring),
  };
}

type Hole = NonNullable<LocalisationView["holes"]>[number];

function seenHole(parts: Parts, base_from_guide: Transform<"base", "guide">, hole: Hole): SeenHole {
  const filed = parts.nail.holes.find((one) => one.id === hole.id);
  const axis: Line = {
    point_mm: base_from_guide.point(hole.entry_point_guide_mm),
    direction: base_from_guide.direction(hole.axis_guide),
  };
  // Of a hole that runs obliquely the way through the nail is longer.
  const across = Math.hypot(filed?.direction[1] ?? 0, filed?.direction[2] ?? 1);
  return {
    id: hole.id,
    diameter_mm: filed?.diameter_mm ?? 0,
    axis,
    exit_mm: axis.point_mm.clone().addScaledVector(axis.direction, parts.nail.diameter_mm / across),
    tilt_to_ray_deg: hole.tilt_to_ray_deg,
    uncertainty: hole.standard_uncertainty ?? null,
  };
}

/** The axis of the guide's hole of that name, in the base's frame; null when the guide has none. */
export function guideAxis(guide: GuidePart, stance: Stance, id: string): Line | null {
  const hole = guide.holes.find((one) => one.id === id);
  if (hole === undefined) return null;
  return {
    point_mm: stance.base_from_guide.point(hole.point_mm),
    direction: stance.base_from_guide.direction(hole.direction),
  };
}

/** How far the guide's hole is from the nail's: what a drill along it would be off. */
export interface Misalignment {
  readonly entry_mm: number;
  readonly exit_mm: number;
  readonly angle_deg: number;
}

export function misalignment(model: SceneModel, stance: Stance | null, hole: SeenHole): Misalignment | null {
  const axis = stance && guideAxis(model.parts.guide, stance, hole.id);
  if (!axis) return null;
  return {
    entry_mm: offsetAcross(axis, hole.axis, hole.axis.point_mm),
    exit_mm: offsetAcross(axis, hole.axis, hole.exit_mm),
    angle_deg: angleBetweenDeg(axis.direction, hole.axis.direction),
  };
}

/** By how much the drill's axis may be off at entry and exit. */
export function play_mm(hole: SeenHole, drill_diameter_mm: number): number {
  return (hole.diameter_mm - drill_diameter_mm) / 2;
}
