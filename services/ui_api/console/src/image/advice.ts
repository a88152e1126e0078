// What the bull's-eye shows, from what the gateway said: pure. Nothing is judged here.
import type { AlignmentView, GuidanceView } from "../api/types";

export interface Advice {
  /** Names the image it is about. */
  readonly of: string;
  /** Turn of the C-arm about the picture's x and y axes; null when none is known, and then `reasons` say why. */
  readonly turn: { readonly x: number; readonly y: number } | null;
  /** Standard deviations of the same. */
  readonly sigma: { readonly x: number; readonly y: number } | null;
  readonly holes: readonly { readonly id: string; readonly deg: number }[];
  readonly orbital: { readonly by: number; readonly to: number } | null;
  readonly angular: { readonly by: number; readonly to: number } | null;
  readonly quality: "good" | "usable" | "too_far" | null;
  readonly savedByADegree: number;
  readonly offCentre: { readonly right: number; readonly down: number } | null;
  readonly shift: { readonly head: number; readonly right: number; readonly up: number } | null;
  readonly isCurrent: boolean;
  readonly staleBecause: string | null;
  readonly ageS: number | null;
  readonly reasons: readonly string[];
}

type Reasons = readonly { readonly message: string }[];

function commonOf(found: Pick<GuidanceView, "assessment" | "off_centre_mm" | "c_arm_correction_deg">) {
  const turn = found.c_arm_correction_deg ?? null;
  const off = found.off_centre_mm ?? null;
  return {
    turn: turn && { x: turn.about_image_x, y: turn.about_image_y },
    quality: found.assessment?.quality ?? null,
    savedByADegree: found.assessment?.saved_by_a_degree ?? 0,
    offCentre: off && { right: off.to_image_right, down: off.to_image_down },
  };
}

/** From a frame of running fluoroscopy. */
export function ofGuidance(found: GuidanceView): Advice {
  const turn = found.positioner_turn_deg;
  const shift = found.positioner_shift_mm ?? null;
  const sigma = found.standard_uncertainty_deg;
  return {
    ...commonOf(found),
    of: found.image.sha256,
    sigma: sigma && { x: sigma.about_image_x, y: sigma.about_image_y },
    holes: (found.holes ?? []).map((hole) => ({ id: hole.id, deg: hole.tilt_to_ray_deg })),
    orbital: turn && { by: turn.orbital, to: turn.orbital_then },
    angular: turn && { by: turn.angular, to: turn.angular_then },
    shift: shift && { head: shift.towards_head, right: shift.to_patients_right, up: shift.up },
    isCurrent: found.validity === "current",
    staleBecause: found.stale_because,
    ageS: found.age_s,
    reasons: textsOf(found.reasons),
  };
}

/** From the newest single image. */
export function ofAlignment(found: AlignmentView, reasons: Reasons): Advice {
  return {
    ...commonOf(found),
    of: found.image,
    sigma: null,
    holes: found.tilts.map((hole) => ({ id: hole.id, deg: hole.tilt_to_ray_deg })),
    orbital: null,
    angular: null,
    shift: null,
    isCurrent: found.validity === "current",
    staleBecause: found.stale_because,
    ageS: found.age_s,
    reasons: textsOf(reasons),
  };
}

function textsOf(reasons: Reasons): readonly string[] {
  return reasons.map((reason) => reason.message);
}

/** The advice of the newest image: a frame's while it is about the moment, else the newest localisation's. */
export function newestAdvice(guidance: GuidanceView | null, alignment: Advice | null): Advice | null {
  if (guidance?.validity === "current") return ofGuidance(guidance);
  return alignment ?? (guidance && ofGuidance(guidance));
}

/**
 * A number that does not flicker between two frames: steps of half a degree below five, of one above; it changes only
 * when the value has left the middle of its step by more than three quarters of it.
 */
export function steadied(value: number, before: number | null): number {
  const step = Math.abs(value) < 5 ? 0.5 : 1;
  if (before !== null && Math.abs(value - before) <= 0.75 * step) return before;
  return Math.round(value / step) * step;
}

/** Tilt at the edge of the bull's-eye. */
export const FULL_DEG = 20;

/** Where a tilt stands, from -1 at the left edge to 1: small ones are spread out, and none leaves the board. */
export function dotPlace(deg: number): number {
  return Math.sign(deg) * Math.min(1, Math.sqrt(Math.abs(deg) / FULL_DEG));
}
