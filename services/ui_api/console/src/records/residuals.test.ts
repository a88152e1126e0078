import { describe, expect, it } from "vitest";
import { largestPx, placeOf, rmsPx } from "./residuals";

const BALLS = [
  { residual_px: 0.3, used: true },
  { residual_px: 0.4, used: true },
  { residual_px: 9, used: false },
  { residual_px: null, used: true },
];

describe("residuals", () => {
  it("are summed up over the balls that the fit used", () => {
    expect(rmsPx(BALLS)).toBeCloseTo(Math.sqrt(0.125));
    expect(largestPx(BALLS)).toBe(0.4);
  });

  it("of no ball are none", () => {
    expect([rmsPx([]), largestPx([])]).toEqual([0, 0]);
  });

  it("stay within the chart", () => {
    expect([-1, 0, 0.25, 1, 50].map(placeOf)).toEqual([0, 0, 0.5, 1, 1]);
  });
});
