import { expect, it } from "vitest";
import { greysOf } from "./decoding";

it("takes one byte of each grey pixel", () => {
  expect(greysOf(new Uint8ClampedArray([7, 7, 7, 255, 200, 200, 200, 255]))).toEqual(
    new Uint8Array([7, 200]),
  );
});
