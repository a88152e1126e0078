import { describe, expect, it } from "vitest";
import { AS_IT_CAME, dragged, lookUpTable, shownPixels } from "./grey";

function greysOf(table: Uint32Array): number[] {
  const bytes = new Uint8Array(table.buffer);
  return Array.from(table, (_, i) => bytes[4 * i] as number);
}

describe("lookUpTable", () => {
  it("changes nothing in a picture as it came", () => {
    expect(greysOf(lookUpTable(AS_IT_CAME, 256))).toEqual(Array.from({ length: 256 }, (_, i) => i));
  });

  it("shows nothing but the window, opaque", () => {
    const table = lookUpTable({ level: 0.5, window: 0.5, isInverted: false }, 256);
    const greys = greysOf(table);
    expect(greys[60]).toBe(0);
    expect(greys[64]).toBeLessThan(3);
    expect(greys[192]).toBeGreaterThan(252);
    expect(greys[200]).toBe(255);
    expect(new Uint8Array(table.buffer)[3]).toBe(255);
  });

  it("is reversed when it is inverted", () => {
    const upright = greysOf(lookUpTable({ level: 0.4, window: 0.7, isInverted: false }, 256));
    const inverted = greysOf(lookUpTable({ level: 0.4, window: 0.7, isInverted: true }, 256));
    for (const i of [0, 90, 120, 255]) expect((upright[i] ?? 0) + (inverted[i] ?? 0)).toBe(255);
  });

  it("has a place for each value of 16 bits", () => {
    const greys = greysOf(lookUpTable({ level: 0.001, window: 0.001, isInverted: false }, 65536));
    expect(greys[0]).toBe(0);
    expect(greys[66]).toBeGreaterThan(120);
    expect(greys[66]).toBeLessThan(135);
    expect(greys[200]).toBe(255);
  });
});

describe("dragged", () => {
  it("widens to the right and brightens downwards, within limits", () => {
    const grey = dragged(AS_IT_CAME, [0.25, 0.1]);
    expect(grey.window).toBeCloseTo(1.25);
    expect(grey.level).toBeCloseTo(0.4);
    expect(dragged(AS_IT_CAME, [-9, 9])).toEqual({ level: 0, window: 0.02, isInverted: false });
  });
});

it("looks every value up", () => {
  const into = new Uint32Array(3);
  shownPixels(new Uint8Array([2, 0, 1]), new Uint32Array([10, 20, 30]), into);
  expect([...into]).toEqual([30, 10, 20]);
});
