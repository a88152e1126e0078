import { describe, expect, it } from "vitest";
import { type HoldEvent, holdReducer, INITIAL_HOLD, mustStop } from "./hold";

function stateAfter(...events: readonly HoldEvent[]) {
  return events.reduce(holdReducer, INITIAL_HOLD);
}

const PRESSED = { kind: "pressed" } as const;
const RELEASED = { kind: "released" } as const;
const ARMED = { kind: "armed" } as const;

describe("holdReducer", () => {
  it("begins nothing by a tap, nor by two", () => {
    expect(stateAfter(PRESSED, RELEASED)).toEqual(INITIAL_HOLD);
    expect(stateAfter(PRESSED, RELEASED, PRESSED, RELEASED)).toEqual(INITIAL_HOLD);
    expect(stateAfter(PRESSED, RELEASED, ARMED)).toEqual(INITIAL_HOLD);
  });

  it("asks for one motion only, however often it is pressed", () => {
    expect(stateAfter(PRESSED, ARMED, PRESSED, ARMED)).toEqual({ phase: "starting", isHeld: true });
  });

  it("must stop when it is released before or after the motion began", () => {
    expect(mustStop(stateAfter(PRESSED, ARMED))).toBe(false);
    expect(mustStop(stateAfter(PRESSED, ARMED, RELEASED))).toBe(true);
    expect(mustStop(stateAfter(PRESSED, ARMED, RELEASED, { kind: "started", operation: "o" }))).toBe(true);
    expect(mustStop(stateAfter(PRESSED, ARMED, { kind: "started", operation: "o" }, RELEASED))).toBe(true);
  });

  it("stays ended until it is pressed again", () => {
    const ended = { kind: "ended", status: "stopped", detail: "released" } as const;
    expect(stateAfter(PRESSED, ARMED, ended, RELEASED)).toEqual({
      phase: "ended",
      status: "stopped",
      detail: "released",
    });
    expect(stateAfter(PRESSED, ARMED, ended, PRESSED).phase).toBe("arming");
  });
});
