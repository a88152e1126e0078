import { describe, expect, it } from "vitest";
import {
  matrixOf,
  mirrored,
  type Point,
  panned,
  pinched,
  type Size,
  toImage,
  toScreen,
  turned,
  type View,
  wholePicture,
  zoomed,
} from "./view";

const image: Size = { width: 1024, height: 768 };
const place: Size = { width: 600, height: 500 };
const someView: View = { zoom: 3, centre: [300, 500], quarterTurns: 1, mirrored: true };

function onScreen(view: View, p: Point): Point {
  return toScreen(matrixOf(view, image, place), p);
}

function expectNear(p: Point, q: Point) {
  expect(p[0]).toBeCloseTo(q[0], 6);
  expect(p[1]).toBeCloseTo(q[1], 6);
}

describe("matrixOf", () => {
  it("shows the whole picture, also when it is turned", () => {
    for (const view of [wholePicture(image), turned(wholePicture(image)), mirrored(wholePicture(image))]) {
      for (const corner of [
        [0, 0],
        [1024, 0],
        [0, 768],
        [1024, 768],
      ] as const) {
        const [x, y] = onScreen(view, corner);
        expect(x).toBeGreaterThanOrEqual(-1e-6);
        expect(x).toBeLessThanOrEqual(place.width + 1e-6);
        expect(y).toBeGreaterThanOrEqual(-1e-6);
        expect(y).toBeLessThanOrEqual(place.height + 1e-6);
      }
    }
  });

  it("is undone by toImage", () => {
    expectNear(toImage(matrixOf(someView, image, place), onScreen(someView, [700, 20])), [700, 20]);
  });
});

describe("turned and mirrored, as one sees them", () => {
  const before = onScreen(wholePicture(image), [1024, 384]); // right of the middle
  const middle: Point = [place.width / 2, place.height / 2];

  it("turns clockwise", () => {
    expect(before[0]).toBeGreaterThan(middle[0]);
    const [x, y] = onScreen(turned(wholePicture(image)), [1024, 384]);
    expect(x).toBeCloseTo(middle[0]);
    expect(y).toBeGreaterThan(middle[1]);
  });

  it("turns clockwise when it is mirrored too", () => {
    const view = mirrored(wholePicture(image)); // the picture's right is at the left now
    expect(onScreen(view, [1024, 384])[0]).toBeLessThan(middle[0]);
    const [x, y] = onScreen(turned(view), [1024, 384]);
    expect(x).toBeCloseTo(middle[0]);
    expect(y).toBeLessThan(middle[1]);
  });

  it("comes back after four turns", () => {
    expect(turned(turned(turned(turned(someView))))).toEqual(someView);
  });
});

describe("moves", () => {
  it("pans with the finger, whatever way the picture is turned", () => {
    const moved = panned(someView, image, place, [12, -7]);
    const [x, y] = onScreen(someView, [310, 490]);
    expectNear(onScreen(moved, [310, 490]), [x + 12, y - 7]);
  });

  it("zooms about the finger", () => {
    const at: Point = [420, 130];
    const under = toImage(matrixOf(someView, image, place), at);
    expectNear(onScreen(zoomed(someView, image, place, at, 1.7), under), at);
  });

  it("keeps what lies under two fingers there", () => {
    const before: readonly [Point, Point] = [
      [100, 100],
      [200, 100],
    ];
    const after: readonly [Point, Point] = [
      [90, 120],
      [240, 120],
    ];
    const under = toImage(matrixOf(someView, image, place), before[0]);
    expectNear(onScreen(pinched(someView, image, place, before, after), under), after[0]);
  });

  it("does not lose the picture", () => {
    const far = panned(wholePicture(image), image, place, [5000, 5000]);
    expect(far.centre).toEqual([0, 0]);
  });
});
