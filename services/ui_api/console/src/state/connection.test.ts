import { describe, expect, it } from "vitest";
import { ageNow, connectionAt, LOST_AFTER_MS } from "./connection";

describe("connectionAt", () => {
  it("counts from the newest answer, or from the page's start", () => {
    expect(connectionAt({ newestAtMs: 1000, startedAtMs: 0 }, 1000 + LOST_AFTER_MS)).toBe("live");
    expect(connectionAt({ newestAtMs: 1000, startedAtMs: 0 }, 1001 + LOST_AFTER_MS)).toBe("lost");
    expect(connectionAt({ newestAtMs: null, startedAtMs: 500 }, 501 + LOST_AFTER_MS)).toBe("lost");
  });

  it("leaves time for a poll to fail and to be drawn within two seconds", () => {
    expect(LOST_AFTER_MS).toBeLessThanOrEqual(1500);
  });
});

describe("ageNow", () => {
  it("adds the time since the value came", () => {
    expect(ageNow(2, 1000, 4500)).toBe(5.5);
    expect(ageNow(null, 1000, 4500)).toBeNull();
  });
});
