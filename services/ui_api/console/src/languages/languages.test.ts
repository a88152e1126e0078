import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { describe, expect, it } from "vitest";
import german from "./de.json";
import english from "./en.json";
import chinese from "./zh.json";

const PLURAL = /_(one|other)$/;

function keysOf(tree: object, prefix = ""): string[] {
  return Object.entries(tree).flatMap(([name, value]) =>
    typeof value === "object" && !Array.isArray(value) ? keysOf(value, `${prefix}${name}.`) : [prefix + name],
  );
}

/** Chinese has no form of its own for one. */
function withoutPlural(tree: object): Set<string> {
  return new Set(keysOf(tree).map((key) => key.replace(PLURAL, "")));
}

function sources(folder: string): string[] {
  return readdirSync(folder, { withFileTypes: true }).flatMap((entry) => {
    const path = join(folder, entry.name);
    if (entry.isDirectory()) return sources(path);
    return /\.tsx?$/.test(entry.name) && !entry.name.includes(".test.") ? [path] : [];
  });
}

describe("languages", () => {
  it.each([
    ["German", german],
    ["Chinese", chinese],
  ])("%s says everything that English says, and nothing else", (_, other) => {
    expect([...withoutPlural(other)].sort()).toEqual([...withoutPlural(english)].sort());
  });

  it("has every text that the page names outright", () => {
    const known = withoutPlural(english);
    const named = sources("src").flatMap((path) =>
      [...readFileSync(path, "utf8").matchAll(/\bt\(\s*"([\w.]+)"/g)].map((match) => match[1] ?? ""),
    );
    expect(named.length).toBeGreaterThan(100);
    expect(named.filter((key) => !known.has(key))).toEqual([]);
  });
});
