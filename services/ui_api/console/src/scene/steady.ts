// The robot's state comes four times a second, with a new number each time; the scene is drawn anew when it has moved.
import { useRef } from "react";
import type { RobotView } from "../api/types";

type State = NonNullable<RobotView["state"]>;

/** Chosen: less than a pixel of the scene in its nearest view. */
const SEEN = 0.005;

/** Whether the platform stands where it stood, as far as one can see: mm and degrees. */
export function isWhereItWas(before: State, now: State): boolean {
  if (before.pose === null || now.pose === null) return before.pose === now.pose;
  const [was, is] = [before.pose, now.pose];
  const axes = ["x_mm", "y_mm", "z_mm", "u_deg", "v_deg", "w_deg"] as const;
  return (
    axes.every((axis) => Math.abs(was[axis] - is[axis]) < SEEN) &&
    before.pivot_mm.every((value, index) => value === now.pivot_mm[index])
  );
}

/** The state, or the one before where nothing of it is to be seen. */
export function useSteadyState(now: State | null): State | null {
  const shown = useRef<State | null>(null);
  if (now === null || shown.current === null || !isWhereItWas(shown.current, now)) shown.current = now;
  return shown.current;
}
