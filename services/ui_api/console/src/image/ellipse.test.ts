import { describe, expect, it } from "vitest";
import { ellipsePath, extentAbout, linePath, residualColour } from "./ellipse";

function numbersOf(path: string): number[] {
  return path
    .split(/[^-\d.e]+/)
    .filter(Boolean)
    .map(Number);
}

describe("ellipsePath", () => {
  it("runs between the ends of the major axis", () => {
    const path = ellipsePath({
      centre_px: [100, 50],
      semi_major_px: 10,
      semi_minor_px: 4,
      major_axis_deg: 90,
    });
    const [x, y, major, minor, deg, , , x2, y2] = numbersOf(path);
    expect([x, y]).toEqual([expect.closeTo(100), expect.closeTo(40)]);
    expect([major, minor, deg]).toEqual([10, 4, 90]);
    expect([x2, y2]).toEqual([expect.closeTo(100), expect.closeTo(60)]);
  });
});

it("joins the points of a line", () => {
  expect(
    linePath([
      [1, 2],
      [3, 4],
    ]),
  ).toBe("M 1 2 L 3 4");
});

it("knows how far lines extend", () => {
  expect(extentAbout([10, 10], [[[12, 7]], [[10, 15]]])).toBe(5);
  expect(extentAbout([10, 10], [])).toBe(1);
});

it("colours by residual from green to red", () => {
  expect(residualColour(0.1)).toBe("hsl(130 90% 60%)");
  expect(residualColour(0.625)).toBe("hsl(65 90% 60%)");
  expect(residualColour(3)).toBe("hsl(0 90% 60%)");
});
