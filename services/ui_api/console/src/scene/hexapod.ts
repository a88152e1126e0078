// Kinematics of the hexapod, as in `shared/geometry/hexapod.py` and `hexapod_limits.py`: numbers of those are in
// `hexapod.fixture.json`, and both sides are tested against it.
import { Euler, MathUtils, Matrix4, type Vector3 } from "three";
import type { HexapodPart, Pose } from "./parts";
import { type Point, Transform, vector } from "./transform";

export const ZERO_POSE: Pose = { x_mm: 0, y_mm: 0, z_mm: 0, u_deg: 0, v_deg: 0, w_deg: 0 };

/** A leg between the centres of its joints, in the base's frame. */
export interface Leg {
  readonly id: string;
  readonly base_mm: Vector3;
  readonly top_mm: Vector3;
  readonly length_mm: number;
  /** Angles between the leg and its direction in the zero pose, as seen by the base and by the top. */
  readonly base_angle_deg: number;
  readonly top_angle_deg: number;
}

/** Where the platform stands: turned by Rx(U)·Ry(V)·Rz(W) about the pivot, which X Y Z displace from its zero pose. */
export function baseFromTop(hexapod: HexapodPart, pose: Pose, pivot_mm: Point): Transform<"base", "top"> {
  const [u, v, w] = [pose.u_deg, pose.v_deg, pose.w_deg].map(MathUtils.degToRad) as [number, number, number];
  const matrix = new Matrix4().makeRotationFromEuler(new Euler(u, v, w, "XYZ"));
  const pivot_base_mm = vector(pivot_mm);
  pivot_base_mm.x += pose.x_mm;
  pivot_base_mm.y += pose.y_mm;
  pivot_base_mm.z += pose.z_mm + hexapod.zero_height_mm;
  matrix.setPosition(pivot_base_mm.sub(vector(pivot_mm).applyMatrix4(matrix)));
  return new Transform(matrix);
}

/** Pose of the guide on the platform, for a head set to this extension. */
export function topFromGuide(hexapod: HexapodPart, head_extension_mm: number): Transform<"top", "guide"> {
  const { top_from_guide_rotation, top_from_guide_translation_at_zero_mm } = hexapod.head;
  const [x, y, z] = top_from_guide_translation_at_zero_mm;
  return Transform.ofRotation(top_from_guide_rotation, [x + head_extension_mm, y, z]);
}

export function legsOf(hexapod: HexapodPart, pose: Pose, pivot_mm: Point): readonly Leg[] {
  const base_from_top = baseFromTop(hexapod, pose, pivot_mm);
  const top_from_base = base_from_top.inverse();
  const zero = baseFromTop(hexapod, ZERO_POSE, pivot_mm);
  return hexapod.legs.map(({ id, base_joint_mm, top_joint_mm }) => {
    const base_mm = vector(base_joint_mm);
    const top_mm = base_from_top.point(top_joint_mm);
    const along = top_mm.clone().sub(base_mm);
    const alongInZero = zero.point(top_joint_mm).sub(base_mm);
    return {
      id,
      base_mm,
      top_mm,
      length_mm: along.length(),
      base_angle_deg: MathUtils.radToDeg(along.angleTo(alongInZero)),
      top_angle_deg: MathUtils.radToDeg(top_from_base.direction(along).angleTo(alongInZero)),
    };
  });
}

/** How much of its room a leg has used: 0 in the middle of its travel with straight joints, 1 at a limit. */
export function usedShare(hexapod: HexapodPart, leg: Leg): number {
  const { minimum, maximum } = hexapod.leg_length_mm;
  const travel = Math.abs(leg.length_mm - (minimum + maximum) / 2) / ((maximum - minimum) / 2);
  const atBase = leg.base_angle_deg / hexapod.base_joint_cone_deg;
  const atTop = leg.top_angle_deg / hexapod.top_joint_cone_deg;
  return Math.max(travel, atBase, atTop);
}

export type Nearness = "free" | "near" | "at_limit";
// Chosen: the last fifth is worth a look, the last twentieth is where a plan hardly goes.
const NEAR = 0.8;
const AT_LIMIT = 0.95;

export function nearness(share: number): Nearness {
  if (share >= AT_LIMIT) return "at_limit";
  return share >= NEAR ? "near" : "free";
}
