import { describe, expect, it } from "vitest";
import { ZERO_POSE } from "./hexapod";
import fixture from "./hexapod.fixture.json";
import { hasEnded, leastSeconds, playedSeconds, shareAt } from "./motion";
import type { HexapodPart } from "./parts";

const HEXAPOD = fixture.hexapod as unknown as HexapodPart;

describe("the planned motion", () => {
  it("takes as long as the slower of way and rotation", () => {
    expect(leastSeconds(HEXAPOD, ZERO_POSE, { ...ZERO_POSE, x_mm: 3, y_mm: 4 })).toBeCloseTo(2.5);
    expect(leastSeconds(HEXAPOD, ZERO_POSE, { ...ZERO_POSE, x_mm: 3, w_deg: -8 })).toBeCloseTo(4);
  });

  it("is played neither too fast to follow nor too slow to wait for", () => {
    expect([0.1, 3, 60].map(playedSeconds)).toEqual([2, 3, 6]);
  });

  it("is played three times", () => {
    expect([0, 10.7, 10.8].map((time) => hasEnded(time, 2))).toEqual([false, false, true]);
  });

  it("rests at both ends, and begins anew", () => {
    expect([0, 0.8, 1.8, 2.8, 3.5, 3.6, 4.4, 5.4].map((time) => shareAt(time, 2))).toEqual([
      0,
      0,
      0.5,
      expect.closeTo(1),
      1,
      0,
      expect.closeTo(0),
      expect.closeTo(0.5),
    ]);
  });
});
