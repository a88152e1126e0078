import { PerspectiveCamera, Vector3 } from "three";
import { expect, it } from "vitest";
import { labelPlace } from "./labels";

const SIZE = { width: 200, height: 100 };

function camera(): PerspectiveCamera {
  const made = new PerspectiveCamera(90, SIZE.width / SIZE.height, 1, 1000);
  made.position.set(0, 0, 100);
  made.updateMatrixWorld();
  return made;
}

it("puts a word where its point is seen, and none where it is not", () => {
  expect(labelPlace(new Vector3(0, 0, 0), camera(), SIZE, 40)).toEqual([100, 50]);
  const [left, top] = labelPlace(new Vector3(100, 50, 0), camera(), SIZE, 40) ?? [0, 0];
  expect(left).toBeCloseTo(150); // half way to the right edge
  expect(top).toBeCloseTo(25); // half way up
  expect(labelPlace(new Vector3(0, 98, 0), camera(), SIZE, 40)).toBeNull();
  expect(labelPlace(new Vector3(0, 0, 150), camera(), SIZE, 40)).toBeNull(); // behind the camera
});

it("keeps a word at the edge whole", () => {
  const [left] = labelPlace(new Vector3(180, 0, 0), camera(), SIZE, 60) ?? [0];
  expect(left).toBe(SIZE.width - 30);
});
