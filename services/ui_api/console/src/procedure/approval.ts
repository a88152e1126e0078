// Approving a plan: pure. Two deliberate acts, of which the second brings the credential; a new plan begins anew.

export interface ApprovalState {
  /** Hash of the plan that is looked at. */
  readonly plan: string;
  readonly phase: "reviewing" | "checked" | "sending";
  /** Why the last attempt failed, by its code; empty when none has. */
  readonly code: string;
  readonly detail: string;
}

export type ApprovalEvent =
  | { readonly kind: "plan"; readonly plan: string }
  | { readonly kind: "checked" }
  | { readonly kind: "back" }
  | { readonly kind: "sent" }
  | { readonly kind: "failed"; readonly code: string; readonly detail: string };

export function startApproval(plan: string): ApprovalState {
  return { plan, phase: "reviewing", code: "", detail: "" };
}

/** The browser came back without a passkey: none was shown, or its finger or PIN was wrong. */
export const PASSKEY_NOT_GIVEN = "passkey_not_given";
const ASKED_AGAIN: ReadonlySet<string> = new Set([
  PASSKEY_NOT_GIVEN,
  "credential_wrong",
  "credential_missing",
  "login_locked",
  "login_busy",
]);

export function approvalReducer(state: ApprovalState, event: ApprovalEvent): ApprovalState {
  switch (event.kind) {
    case "plan":
      return event.plan === state.plan ? state : startApproval(event.plan);
    case "checked":
      return state.phase === "reviewing" ? { ...state, phase: "checked", code: "", detail: "" } : state;
    case "back":
      return state.phase === "checked" ? startApproval(state.plan) : state;
    case "sent":
      return state.phase === "checked" ? { ...state, phase: "sending", code: "", detail: "" } : state;
    case "failed": {
      // Only the credential may be sent again at once; after anything else the plan is looked at again.
      const phase = ASKED_AGAIN.has(event.code) ? "checked" : "reviewing";
      return { ...state, phase, code: event.code, detail: event.detail };
    }
  }
}

/**
 * Bound of an offset, in 95 of 100 cases, from its prediction and its root mean square over both directions: the
 * distance from a point of a normal distribution in the plane, whose 95 % radius is 1.73 times its rms.
 */
export function bound95Mm(offsetMm: number, rmsMm: number): number {
  return offsetMm + 1.73 * rmsMm;
}
