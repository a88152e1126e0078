import { describe, expect, it } from "vitest";
import { radius95Mm } from "./uncertainty";

describe("radius95Mm", () => {
  it("is the 95 % radius of a point at the entry, and grows along the axis on both sides", () => {
    const uncertainty = { entry_mm: 0.1, axis_deg: 0.5 };
    expect(radius95Mm(uncertainty, 0)).toBeCloseTo(0.173, 3);
    expect(radius95Mm(uncertainty, 100)).toBeCloseTo(1.73 * Math.hypot(0.1, 0.8727), 3);
    expect(radius95Mm(uncertainty, -100)).toBe(radius95Mm(uncertainty, 100));
  });
});
