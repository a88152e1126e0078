import { expect, it } from "vitest";
import { sentence } from "./sentence";

it.each([
  ["take one more image", "Take one more image."],
  ["find out why, then acknowledge it (POST /robot/acknowledge-stop)", "Find out why, then acknowledge it."],
  [
    "reference it (POST /robot/reference); in a fault see to its cause and reset it; see GET /robot",
    "Reference it; in a fault see to its cause and reset it.",
  ],
  ["see which side it is; correct the case", "See which side it is; correct the case."],
  ["正在运动", "正在运动。"],
  ["", ""],
])("%s", (phrase, said) => {
  expect(sentence(phrase)).toBe(said);
});
