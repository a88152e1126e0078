import { describe, expect, it } from "vitest";
import type { GuidanceView } from "../api/types";
import { type Advice, dotPlace, newestAdvice, ofGuidance, steadied } from "./advice";

const guidance = {
  image: { sha256: "a" },
  c_arm_correction_deg: { about_image_x: 3, about_image_y: -1 },
  positioner_turn_deg: { orbital: 2, angular: -1, orbital_then: 88, angular_then: 4 },
  positioner_shift_mm: { towards_head: 5, to_patients_right: 0, up: -7 },
  off_centre_mm: { to_image_right: 5, to_image_down: 7 },
  standard_uncertainty_deg: { about_image_x: 0.1, about_image_y: 0.2 },
  assessment: { quality: "usable", largest_tilt_deg: 3.4, saved_by_a_degree: 0.07 },
  holes: [{ id: "distal", tilt_to_ray_deg: 3.4 }],
  reasons: [],
  validity: "current",
  stale_because: null,
  age_s: 0.2,
} as unknown as GuidanceView;
const single = { of: "b" } as Advice;

describe("newestAdvice", () => {
  it("is the running frame's while that is about the moment", () => {
    expect(newestAdvice(guidance, single)?.of).toBe("a");
    expect(newestAdvice({ ...guidance, validity: "stale" }, single)?.of).toBe("b");
    expect(newestAdvice(null, single)?.of).toBe("b");
    expect(newestAdvice({ ...guidance, validity: "stale" }, null)?.isCurrent).toBe(false);
    expect(newestAdvice(null, null)).toBeNull();
  });

  it("shows nothing of a frame that was rejected", () => {
    const rejected = {
      ...guidance,
      c_arm_correction_deg: null,
      assessment: null,
      reasons: [{ message: "no guide" }],
    } as unknown as GuidanceView;
    const advice = ofGuidance(rejected);
    expect([advice.turn, advice.quality, advice.reasons]).toEqual([null, null, ["no guide"]]);
  });
});

describe("steadied", () => {
  it("stays where noise of a tenth of a degree shakes it", () => {
    let shown: number | null = null;
    const seen = new Set<number>();
    for (const value of [2.24, 2.3, 2.18, 2.27, 2.22, 2.31]) {
      shown = steadied(value, shown);
      seen.add(shown);
    }
    expect(seen.size).toBe(1);
  });

  it("follows a true change", () => {
    expect(steadied(4, 2)).toBe(4);
    expect(steadied(-7.4, 2)).toBe(-7);
  });
});

it("keeps the dot on the board, on its side, farther out for more", () => {
  expect(dotPlace(0)).toBe(0);
  expect(dotPlace(90)).toBe(1);
  expect(dotPlace(-6)).toBe(-dotPlace(6));
  for (const deg of [0.5, 1, 2, 5, 10, 19]) expect(dotPlace(deg + 0.5)).toBeGreaterThan(dotPlace(deg));
});
