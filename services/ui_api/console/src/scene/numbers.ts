// The numbers beside the picture: pure.
import type { LocalisationView, PlanView, VerificationView } from "../api/types";
import { usedShare } from "./hexapod";
import { misalignment, type SceneModel, type Stance } from "./sceneModel";
import { angleBound95Deg, offsetBound95Mm } from "./uncertainty";

/** An axis of the guide against that of the nail's hole. */
export interface AxisNumbers {
  readonly offset_mm: number;
  readonly offset_bound_mm: number | null;
  readonly angle_deg: number;
  readonly angle_bound_deg: number | null;
  readonly chance_to_pass: number | null;
}

export interface HoleNumbers {
  readonly id: string;
  readonly tilt_to_ray_deg: number | null;
  readonly now: AxisNumbers | null;
  readonly planned: AxisNumbers | null;
}

export interface LegNumbers {
  readonly id: string;
  readonly used_share: number;
}

interface Results {
  readonly localisation: LocalisationView | null;
  readonly plan: PlanView | null;
  readonly verification: VerificationView | null;
}

export function holeNumbers(model: SceneModel, { localisation, plan, verification }: Results): HoleNumbers[] {
  const holes = model.seen?.holes ?? [];
  const predicted = plan?.validity === "current" ? plan.plan.predicted : [];
  // What a drill would do now was measured only where the newest image is one of those verified.
  const verified = verification?.images.includes(localisation?.image.sha256 ?? "")
    ? verification.guide_holes
    : [];
  const ids = new Set([...holes, ...predicted].map((hole) => hole.id));
  return [...ids].map((id) => {
    const hole = holes.find((one) => one.id === id);
    const off = hole && misalignment(model, model.now, hole);
    const measured = verified?.find((one) => one.id === id);
    const after = predicted.find((one) => one.id === id);
    return {
      id,
      tilt_to_ray_deg: hole?.tilt_to_ray_deg ?? null,
      now: off
        ? numbersOf(off.entry_mm, off.angle_deg, hole.uncertainty, measured?.chance_to_pass ?? null)
        : null,
      planned: after
        ? numbersOf(after.offset_mm, after.angle_deg, after.standard_uncertainty, after.chance_to_pass)
        : null,
    };
  });
}

type Uncertainty = { readonly entry_mm: number; readonly axis_deg: number } | null;

function numbersOf(offset_mm: number, angle_deg: number, u: Uncertainty, chance: number | null): AxisNumbers {
  return {
    offset_mm,
    offset_bound_mm: u && offsetBound95Mm(offset_mm, u),
    angle_deg,
    angle_bound_deg: u && angleBound95Deg(angle_deg, u),
    chance_to_pass: chance,
  };
}

/** The leg that has used most of its room. */
export function nearestLeg(model: SceneModel, stance: Stance | null): LegNumbers | null {
  const used = (stance?.legs ?? []).map((leg) => ({
    id: leg.id,
    used_share: usedShare(model.parts.hexapod, leg),
  }));
  return used.reduce<LegNumbers | null>(
    (most, one) => (most && most.used_share >= one.used_share ? most : one),
    null,
  );
}
