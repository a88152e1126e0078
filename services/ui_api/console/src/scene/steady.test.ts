import { expect, it } from "vitest";
import type { RobotView } from "../api/types";
import { ZERO_POSE } from "./hexapod";
import { isWhereItWas } from "./steady";

type State = NonNullable<RobotView["state"]>;

function at(x_mm: number, pivot_mm = [0, 0, 80]): State {
  return { pose: { ...ZERO_POSE, x_mm }, pivot_mm } as unknown as State;
}

it("draws the scene anew when the platform or its pivot has moved, not for noise of its encoders", () => {
  expect(isWhereItWas(at(1), at(1.001))).toBe(true);
  expect(isWhereItWas(at(1), at(1.01))).toBe(false);
  expect(isWhereItWas(at(1), at(1, [0, 0, 81]))).toBe(false);
  expect(isWhereItWas(at(1), { ...at(1), pose: null })).toBe(false);
});
