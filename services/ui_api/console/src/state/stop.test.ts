import { describe, expect, it } from "vitest";
import { INITIAL_STOP, type StopEvent, stopReducer } from "./stop";

function stateAfter(...events: readonly StopEvent[]) {
  return events.reduce(stopReducer, INITIAL_STOP);
}

describe("stopReducer", () => {
  it("keeps what was confirmed when a later answer to an earlier press fails", () => {
    const state = stateAfter(
      { kind: "pressed" },
      { kind: "pressed" },
      { kind: "confirmed", detail: "at rest" },
      { kind: "failed", detail: "late" },
    );
    expect(state).toEqual({ phase: "confirmed", detail: "at rest", pending: 0 });
  });

  it("says that a stop was not confirmed until it is pressed again", () => {
    expect(stateAfter({ kind: "pressed" }, { kind: "failed", detail: "no answer" }).phase).toBe(
      "not_confirmed",
    );
    expect(stateAfter({ kind: "pressed" }, { kind: "failed", detail: "" }, { kind: "pressed" }).phase).toBe(
      "sent",
    );
  });

  it("is not cleared while a stop is under way", () => {
    expect(stateAfter({ kind: "pressed" }, { kind: "cleared" }).phase).toBe("sent");
    expect(stateAfter({ kind: "pressed" }, { kind: "confirmed", detail: "" }, { kind: "cleared" })).toEqual(
      INITIAL_STOP,
    );
  });
});
