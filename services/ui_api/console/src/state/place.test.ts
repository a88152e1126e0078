import { describe, expect, it } from "vitest";
import { casePath, placeOf } from "./place";

describe("placeOf", () => {
  it("finds back what the address names, and the room otherwise", () => {
    expect(placeOf(casePath("case-1a2b"))).toEqual({ name: "case", id: "case-1a2b" });
    expect(placeOf("#/cases")).toEqual({ name: "cases" });
    expect(placeOf("#/wall")).toEqual({ name: "wall" });
    expect(placeOf("")).toEqual({ name: "room" });
    expect(placeOf("#/nonsense")).toEqual({ name: "room" });
    expect(placeOf("#/cases/../users")).toEqual({ name: "cases" });
  });
});
