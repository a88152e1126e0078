// The planned motion, as the controller makes it: all six axes run linearly and together.
import type { HexapodPart, Pose } from "./parts";

/** The pose after a share of the way, 0 to 1. */
export function poseAlong(start: Pose, target: Pose, share: number): Pose {
  const between = (from: number, to: number) => from + (to - from) * share;
  return {
    x_mm: between(start.x_mm, target.x_mm),
    y_mm: between(start.y_mm, target.y_mm),
    z_mm: between(start.z_mm, target.z_mm),
    u_deg: between(start.u_deg, target.u_deg),
    v_deg: between(start.v_deg, target.v_deg),
    w_deg: between(start.w_deg, target.w_deg),
  };
}

/** Shortest time that the motion takes at the platform's greatest speeds. */
export function leastSeconds(hexapod: HexapodPart, start: Pose, target: Pose): number {
  const { translation_mm_per_s, rotation_deg_per_s } = hexapod.speed_limits;
  const way_mm = Math.hypot(target.x_mm - start.x_mm, target.y_mm - start.y_mm, target.z_mm - start.z_mm);
  const turn_deg = Math.hypot(
    target.u_deg - start.u_deg,
    target.v_deg - start.v_deg,
    target.w_deg - start.w_deg,
  );
  return Math.max(way_mm / translation_mm_per_s, turn_deg / rotation_deg_per_s);
}

// Chosen: long enough to see which way it goes, and a rest at each end to see where it begins and stops.
const PLAYED_S = { least: 2, most: 6 };
const REST_S = 0.8;
// Then it stands at the target, and costs no pictures any more.
const TIMES = 3;

export function playedSeconds(least_s: number): number {
  return Math.min(Math.max(least_s, PLAYED_S.least), PLAYED_S.most);
}

/** Share of the way at a time of the loop: rest at the start, the way, rest at the target, and again. */
export function shareAt(time_s: number, played_s: number): number {
  const at = (time_s % (played_s + 2 * REST_S)) - REST_S;
  return Math.min(Math.max(at / played_s, 0), 1);
}

/** Whether it was played often enough. */
export function hasEnded(time_s: number, played_s: number): boolean {
  return time_s >= TIMES * (played_s + 2 * REST_S);
}
