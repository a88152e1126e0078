import { useCallback, useReducer } from "react";
import { ApiError } from "../api/client";
import { stopRobot } from "../api/stop";
import { INITIAL_STOP, type StopState, stopReducer } from "./stop";

/** The stop and what came of it. Pressing again sends it again: a stop is never refused. */
export function useStop(): readonly [StopState, () => void] {
  const [state, dispatch] = useReducer(stopReducer, INITIAL_STOP);
  const press = useCallback(() => {
    // First the request, then anything that draws.
    const answer = stopRobot();
    dispatch({ kind: "pressed" });
    answer.then(
      (view) => dispatch({ kind: "confirmed", detail: view.detail }),
      (error: unknown) =>
        dispatch({ kind: "failed", detail: error instanceof ApiError ? error.detail : String(error) }),
    );
  }, []);
  return [state, press];
}
