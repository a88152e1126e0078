// What the stop button shows: pure.

export interface StopState {
  readonly phase: "idle" | "sent" | "confirmed" | "not_confirmed";
  readonly detail: string;
  /** Requests that have not been answered. */
  readonly pending: number;
}

export type StopEvent =
  | { readonly kind: "pressed" }
  | { readonly kind: "confirmed"; readonly detail: string }
  | { readonly kind: "failed"; readonly detail: string }
  | { readonly kind: "cleared" };

export const INITIAL_STOP: StopState = { phase: "idle", detail: "", pending: 0 };

export function stopReducer(state: StopState, event: StopEvent): StopState {
  switch (event.kind) {
    case "pressed":
      return { phase: "sent", detail: "", pending: state.pending + 1 };
    case "confirmed":
      return { phase: "confirmed", detail: event.detail, pending: Math.max(0, state.pending - 1) };
    case "failed":
      // One that was confirmed meanwhile holds: the robot is at rest.
      if (state.phase === "confirmed") return { ...state, pending: Math.max(0, state.pending - 1) };
      return { phase: "not_confirmed", detail: event.detail, pending: Math.max(0, state.pending - 1) };
    case "cleared":
      return state.pending > 0 ? state : INITIAL_STOP;
  }
}
