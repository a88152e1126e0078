import { expect, it } from "vitest";
import { ageText } from "./ages";

it.each([
  [0.4, "0 s"],
  [59.9, "59 s"],
  [65, "1 min 05 s"],
  [3600, "1 h 00 min"],
  [7800, "2 h 10 min"],
])("%s s is %s", (seconds, text) => {
  expect(ageText(seconds)).toBe(text);
});
