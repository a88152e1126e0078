import { describe, expect, it } from "vitest";
import { translated } from "./gateway";
import german from "./gateway.de.json";
import chinese from "./gateway.zh.json";

const NAME = /\{\w+\}/g;

describe("sentences of the gateway", () => {
  it("are said in the page's language, with their values", () => {
    expect(translated("Start the motion.", german)).toBe("Die Bewegung starten.");
    expect(translated("Drill through the guide: distal, proximal.", chinese)).toBe(
      "通过导向器钻孔：远端、近端。",
    );
    expect(translated("plan 3 is stale: localisation 4 is newer", german)).toBe(
      "Plan 3 ist überholt: localisation 4 is newer",
    );
  });

  it("stay as they are where they are not known", () => {
    expect(translated("leg 3 is too long", german)).toBe("leg 3 is too long");
    expect(translated("constructor", german)).toBe("constructor");
  });

  it.each([
    ["German", german],
    ["Chinese", chinese],
  ])("quote the same values in %s", (_, known) => {
    for (const [english, translation] of Object.entries(known)) {
      const missing = (english.match(NAME) ?? []).filter((name) => !translation.includes(name));
      expect([english, translation.match(NAME)?.filter((name) => !english.includes(name)) ?? []]).toEqual([
        english,
        [],
      ]);
      // Only what names a request may be left out: it is for programs.
      if (!english.startsWith("GET ")) expect([english, missing]).toEqual([english, []]);
    }
  });
});
