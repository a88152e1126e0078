import { describe, expect, it } from "vitest";
import { choiceOf, isLiveShown, wantedOf } from "./choice";

const stored = { id: "b", header: { sequence: 7 } };
const live = { image: "c", pictureOf: "c", sequence: 8 };

describe("choiceOf", () => {
  it("shows a live picture that is newer than the record", () => {
    expect(choiceOf(live, stored)).toEqual({ isAhead: true, isSame: false });
    expect(choiceOf(live, null).isAhead).toBe(true);
  });

  it("shows no older live picture, and none that has not come", () => {
    expect(choiceOf({ ...live, sequence: 6 }, stored).isAhead).toBe(false);
    expect(choiceOf({ ...live, pictureOf: null }, stored).isAhead).toBe(false);
    expect(choiceOf(null, stored).isAhead).toBe(false);
  });
});

describe("isLiveShown", () => {
  const same = choiceOf({ image: "b", pictureOf: "b", sequence: 7 }, stored);

  it("bridges the time until the stored picture is there", () => {
    expect(isLiveShown(same, "b", "a")).toBe(true);
    expect(isLiveShown(same, "b", "b")).toBe(false);
  });
});

describe("wantedOf", () => {
  const localised = { image: { sha256: "b", mirrored: true }, camera: {} };

  it("corrects only what was measured, and then shows it as the C-arm does", () => {
    expect(wantedOf(stored, localised, true)).toEqual({ image: "b", view: "corrected", isReversed: true });
    expect(wantedOf(stored, { ...localised, camera: null }, true)?.view).toBe("raw");
    expect(wantedOf({ ...stored, id: "z" }, localised, true)?.view).toBe("raw");
    expect(wantedOf(stored, localised, false)).toEqual({ image: "b", view: "raw", isReversed: false });
    expect(wantedOf(null, localised, true)).toBeNull();
  });
});
