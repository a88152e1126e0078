import { describe, expect, it } from "vitest";
import { endNear, lengthsOf, scalesOf } from "./ruler";

describe("scalesOf", () => {
  it("takes what was measured before what the header states", () => {
    const measured = {
      mm_per_px_at_detector: 0.3,
      raw: {
        holes: [
          { localised: true, mm_per_px: 0.2 },
          { localised: true, mm_per_px: 0.22 },
          { localised: false, mm_per_px: 9 },
        ],
      },
    };
    const scales = scalesOf(measured, 0.4);
    expect(scales?.holeMmPerPx).toBeCloseTo(0.21);
    expect(scales?.isNominal).toBe(false);
    expect(scalesOf(null, 0.4)).toEqual({ detectorMmPerPx: 0.4, holeMmPerPx: null, isNominal: true });
    expect(scalesOf(null, null)).toBeNull();
    expect(scalesOf(null, 0)).toBeNull();
  });
});

it("measures at detector and hole", () => {
  const scales = { detectorMmPerPx: 0.3, holeMmPerPx: 0.2, isNominal: false };
  const lengths = lengthsOf(
    [
      [0, 0],
      [30, 40],
    ],
    scales,
  );
  expect(lengths.detectorMm).toBeCloseTo(15);
  expect(lengths.holeMm).toBeCloseTo(10);
});

it("takes the nearer end, if one is within reach", () => {
  const line = [
    [0, 0],
    [100, 0],
  ] as const;
  expect(endNear(line, [95, 5], 20)).toBe(1);
  expect(endNear(line, [4, 5], 20)).toBe(0);
  expect(endNear(line, [50, 0], 20)).toBeNull();
});
