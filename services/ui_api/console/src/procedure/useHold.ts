import { useQueryClient } from "@tanstack/react-query";
import { useCallback, useEffect, useReducer } from "react";
import { act } from "../api/actions";
import { ApiError, content, gateway } from "../api/client";
import { CASE } from "../api/queries";
import { stopRobot } from "../api/stop";
import type { PlanView, ReadCase } from "../api/types";
import { ARM_MS, type HoldState, holdReducer, INITIAL_HOLD, isUnderWay, mustStop } from "./hold";

// A third of the lease that the gateway grants unless set otherwise (0.5 s).
const LEASE_EVERY_MS = 150;
const LEASE_WITHIN_MS = 400;
const LOOK_EVERY_MS = 250;
const CONFLICT = 409;
const FINAL: ReadonlySet<string> = new Set(["succeeded", "failed", "stopped"]);

export interface Hold {
  readonly state: HoldState;
  readonly press: () => void;
  readonly release: () => void;
}

/** Begin the motion of an approved plan by holding, keep it going, and stop it when the finger leaves. */
export function useHold(read: ReadCase, plan: PlanView | null): Hold {
  const client = useQueryClient();
  const [state, dispatch] = useReducer(holdReducer, INITIAL_HOLD);
  const press = useCallback(() => dispatch({ kind: "pressed" }), []);
  const release = useCallback(() => dispatch({ kind: "released" }), []);

  useEffect(() => {
    if (state.phase !== "arming") return;
    const timer = setTimeout(() => dispatch({ kind: "armed" }), ARM_MS);
    return () => clearTimeout(timer);
  }, [state.phase]);

  const isStarting = state.phase === "starting";
  // biome-ignore lint/correctness/useExhaustiveDependencies: it begins once, with the plan and the case as they were then
  useEffect(() => {
    if (!isStarting || plan === null) return;
    act.startMotion(read, plan.number, true).then(
      (operation) => dispatch({ kind: "started", operation: operation.id }),
      (error: unknown) => dispatch({ kind: "ended", status: "refused", detail: detailOf(error) }),
    );
  }, [isStarting]);

  const operation = state.phase === "moving" ? state.operation : null;
  const isHeld = state.phase === "moving" && state.isHeld;
  useEffect(() => {
    if (operation === null || !isHeld) return;
    const leave = every(LEASE_EVERY_MS, () =>
      act.renewLease(operation, AbortSignal.timeout(LEASE_WITHIN_MS)).catch((error: unknown) => {
        // It has ended, or its lease has lapsed: in either case nothing is held any more.
        if (error instanceof ApiError && error.status === CONFLICT) leave();
      }),
    );
    return leave;
  }, [operation, isHeld]);

  useEffect(() => {
    if (operation === null) return;
    return every(LOOK_EVERY_MS, async () => {
      const view = await content(
        gateway.GET("/api/v1/operations/{operation_id}", { params: { path: { operation_id: operation } } }),
      ).catch(() => null);
      if (view === null || !FINAL.has(view.status)) return;
      dispatch({ kind: "ended", status: view.status, detail: view.detail });
      void client.invalidateQueries({ queryKey: [CASE] });
    });
  }, [operation, client]);

  const stops = mustStop(state);
  useEffect(() => {
    // Without it the robot stops all the same, when the lease lapses.
    if (stops) stopRobot().catch(() => null);
  }, [stops]);

  useReleaseWhenLeft(isUnderWay(state) || state.phase === "arming", release);
  return { state, press, release };
}

/** Whatever takes the page away from the surgeon counts as letting go. */
function useReleaseWhenLeft(isOn: boolean, release: () => void): void {
  useEffect(() => {
    if (!isOn) return;
    const onHidden = () => document.hidden && release();
    window.addEventListener("blur", release);
    document.addEventListener("visibilitychange", onHidden);
    return () => {
      window.removeEventListener("blur", release);
      document.removeEventListener("visibilitychange", onHidden);
    };
  }, [isOn, release]);
}

function every(intervalMs: number, act: () => Promise<unknown>): () => void {
  void act();
  const timer = setInterval(() => void act(), intervalMs);
  return () => clearInterval(timer);
}

function detailOf(error: unknown): string {
  return error instanceof ApiError ? error.detail : String(error);
}
