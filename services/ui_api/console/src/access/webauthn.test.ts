import { expect, it } from "vitest";
import { bytesOf, textOf } from "./webauthn";

it("writes bytes without padding and with signs that addresses may have", () => {
  expect(textOf(new Uint8Array([0xfb, 0xff, 0xfe, 0x00]).buffer)).toBe("-__-AA");
});

it("reads what it writes", () => {
  const bytes = Uint8Array.from({ length: 256 }, (_, value) => value);
  expect(new Uint8Array(bytesOf(textOf(bytes.buffer)))).toEqual(bytes);
});
