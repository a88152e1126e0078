// Holding to move: pure. A motion begins only after a deliberate hold, so that no tap, single or double, begins one.

export type HoldState =
  | { readonly phase: "idle" }
  /** Held, but not long enough yet. */
  | { readonly phase: "arming" }
  /** The motion was asked for; its operation is not known yet. */
  | { readonly phase: "starting"; readonly isHeld: boolean }
  | { readonly phase: "moving"; readonly operation: string; readonly isHeld: boolean }
  | { readonly phase: "ended"; readonly status: string; readonly detail: string };

export type HoldEvent =
  | { readonly kind: "pressed" }
  | { readonly kind: "armed" }
  | { readonly kind: "released" }
  | { readonly kind: "started"; readonly operation: string }
  | { readonly kind: "ended"; readonly status: string; readonly detail: string };

export const INITIAL_HOLD: HoldState = { phase: "idle" };
/** Chosen: longer than any tap, and than a double tap together. */
export const ARM_MS = 600;

export function holdReducer(state: HoldState, event: HoldEvent): HoldState {
  switch (event.kind) {
    case "pressed":
      return state.phase === "idle" || state.phase === "ended" ? { phase: "arming" } : state;
    case "armed":
      return state.phase === "arming" ? { phase: "starting", isHeld: true } : state;
    case "released":
      return released(state);
    case "started":
      return state.phase === "starting"
        ? { phase: "moving", operation: event.operation, isHeld: state.isHeld }
        : state;
    case "ended":
      return { phase: "ended", status: event.status, detail: event.detail };
  }
}

function released(state: HoldState): HoldState {
  if (state.phase === "arming") return INITIAL_HOLD;
  return state.phase === "starting" || state.phase === "moving" ? { ...state, isHeld: false } : state;
}

/** Whether the motion is, or may be, under way. */
export function isUnderWay(state: HoldState): boolean {
  return state.phase === "starting" || state.phase === "moving";
}

/** Whether the finger has left while the motion is, or may be, under way: then it must be stopped. */
export function mustStop(state: HoldState): boolean {
  return (state.phase === "starting" || state.phase === "moving") && !state.isHeld;
}
