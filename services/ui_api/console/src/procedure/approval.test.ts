import { describe, expect, it } from "vitest";
import { type ApprovalEvent, approvalReducer, bound95Mm, startApproval } from "./approval";

function stateAfter(...events: readonly ApprovalEvent[]) {
  return events.reduce(approvalReducer, startApproval("a"));
}

describe("approvalReducer", () => {
  it("sends nothing before the plan was checked", () => {
    expect(stateAfter({ kind: "sent" }).phase).toBe("reviewing");
    expect(stateAfter({ kind: "checked" }, { kind: "sent" }).phase).toBe("sending");
  });

  it("begins anew when the plan is another one, and only then", () => {
    expect(stateAfter({ kind: "checked" }, { kind: "plan", plan: "b" })).toEqual(startApproval("b"));
    expect(stateAfter({ kind: "checked" }, { kind: "plan", plan: "a" }).phase).toBe("checked");
  });

  it("asks for the credential again when it was wrong, and for a look when the session ended", () => {
    const sent = [{ kind: "checked" }, { kind: "sent" }] as const;
    expect(stateAfter(...sent, { kind: "failed", code: "credential_wrong", detail: "" }).phase).toBe(
      "checked",
    );
    expect(stateAfter(...sent, { kind: "failed", code: "token_expired", detail: "" }).phase).toBe(
      "reviewing",
    );
    expect(stateAfter(...sent, { kind: "failed", code: "plan_hash_mismatch", detail: "" }).phase).toBe(
      "reviewing",
    );
  });
});

describe("bound95Mm", () => {
  it("is the 95 % radius of a normal distribution in the plane", () => {
    // Rayleigh: sigma = rms / sqrt(2), radius = sigma * sqrt(-2 ln 0.05).
    expect(bound95Mm(0, 1)).toBeCloseTo(Math.sqrt(-Math.log(0.05)), 2);
    expect(bound95Mm(0.3, 0.1)).toBeCloseTo(0.473, 3);
  });
});
