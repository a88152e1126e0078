import { describe, expect, it } from "vitest";
import { baseFromTop, legsOf, nearness, topFromGuide, usedShare, ZERO_POSE } from "./hexapod";
import fixture from "./hexapod.fixture.json";
import { poseAlong } from "./motion";
import type { HexapodPart } from "./parts";
import type { Point } from "./transform";

const HEXAPOD = fixture.hexapod as unknown as HexapodPart;
// The fixture is rounded to a nanometre.
const DIGITS = 5;

function close(found: readonly number[], wanted: readonly number[]) {
  expect(found).toHaveLength(wanted.length);
  found.forEach((value, index) => {
    expect(value).toBeCloseTo(wanted[index] ?? Number.NaN, DIGITS);
  });
}

describe("the hexapod's kinematics are those of shared/geometry/hexapod.py", () => {
  it.each(fixture.cases.map((one, index) => [index, one] as const))("in pose %d", (_, one) => {
    const pivot_mm = one.pivot_mm as unknown as Point;
    const legs = legsOf(HEXAPOD, one.pose, pivot_mm);
    close(
      legs.map((leg) => leg.length_mm),
      one.leg_lengths_mm,
    );
    close(
      legs.map((leg) => leg.base_angle_deg),
      one.base_angles_deg,
    );
    close(
      legs.map((leg) => leg.top_angle_deg),
      one.top_angles_deg,
    );
    const guide = baseFromTop(HEXAPOD, one.pose, pivot_mm).after(
      topFromGuide(HEXAPOD, one.head_extension_mm),
    );
    close(guide.matrix.clone().transpose().toArray(), one.base_from_guide.flat());
  });

  it("moves straight in all six axes", () => {
    const { start, target, share, pose } = fixture.path;
    close(Object.values(poseAlong(start, target, share)), Object.values(pose));
  });
});

describe("usedShare", () => {
  const [leg] = legsOf(HEXAPOD, ZERO_POSE, HEXAPOD.pivot_mm);
  if (leg === undefined) throw new Error("the hexapod has no legs");

  it("is 1 at either end of the leg's travel, and 0 in its middle", () => {
    expect(usedShare(HEXAPOD, { ...leg, length_mm: HEXAPOD.leg_length_mm.minimum })).toBeCloseTo(1);
    expect(usedShare(HEXAPOD, { ...leg, length_mm: HEXAPOD.leg_length_mm.maximum })).toBeCloseTo(1);
    expect(usedShare(HEXAPOD, { ...leg, length_mm: 45 })).toBeCloseTo(0);
  });

  it("counts the joint that is bent most", () => {
    const bent = { ...leg, length_mm: 45, base_angle_deg: 5, top_angle_deg: 22.5 };
    expect(usedShare(HEXAPOD, bent)).toBeCloseTo(0.9);
  });

  it("becomes a word before the limit", () => {
    expect([0.79, 0.8, 0.95, 1.2].map(nearness)).toEqual(["free", "near", "at_limit", "at_limit"]);
  });
});
