// Alarms with the priorities of IEC 60601-1-8, from what the page knows: pure. The texts are in the language files.
import type { CheckView, RobotSnapshot } from "../api/types";
import type { Connection } from "./connection";

export type Priority = "high" | "medium" | "low";

export interface Alarm {
  readonly id: string;
  readonly priority: Priority;
  /** Put into the alarm's text. */
  readonly values: Readonly<Record<string, string>>;
}

export interface Known {
  readonly connection: Connection;
  readonly robot: RobotSnapshot | null;
  readonly checks: readonly CheckView[];
  readonly stopNotConfirmed: boolean;
  readonly hasCase: boolean;
}

const RANK: Readonly<Record<Priority, number>> = { high: 0, medium: 1, low: 2 };
const NONE: Readonly<Record<string, string>> = {};
// Said by the robot's own alarms already.
const OF_THE_ROBOT: ReadonlySet<string> = new Set(["robot_state"]);
const LOW: ReadonlySet<string> = new Set(["disk"]);

/** What holds now, the most urgent first. */
export function alarmsOf(known: Known): readonly Alarm[] {
  const found = [...ofConnection(known), ...ofRobot(known), ...ofChecks(known)];
  if (known.stopNotConfirmed) found.push(alarm("stop_not_confirmed", "high"));
  return found.sort((one, other) => RANK[one.priority] - RANK[other.priority]);
}

function ofConnection({ connection, robot }: Known): Alarm[] {
  if (connection === "live") return [];
  // What moved when it was last heard of may move still, and nobody sees it here.
  return [isMoving(robot) ? alarm("lost_in_motion", "high") : alarm("lost", "medium")];
}

function ofRobot({ connection, robot, hasCase }: Known): Alarm[] {
  if (connection === "lost" || robot === null) return [];
  const { state, validity } = robot.view;
  if (state === null || validity !== "current")
    return [isMoving(robot) ? alarm("robot_silent_in_motion", "high") : alarm("robot_silent", "medium")];
  const found: Alarm[] = [];
  if (state.state === "fault") found.push(alarm("robot_fault", "high", { detail: state.detail ?? "" }));
  if (state.state === "disconnected") found.push(alarm("robot_disconnected", "medium"));
  if (state.stop_button === "pressed") found.push(alarm("stop_button_pressed", "medium"));
  else if (state.stop === "latched" && hasCase) found.push(alarm("stop_in_force", "low"));
  return found;
}

function ofChecks({ connection, checks }: Known): Alarm[] {
  if (connection === "lost") return [];
  return checks
    .filter((check) => !check.ok && !OF_THE_ROBOT.has(check.name))
    .map((check) =>
      alarm("not_ready", LOW.has(check.name) ? "low" : "medium", {
        part: check.name,
        measured: check.measured,
        remedy: check.remedy,
      }),
    );
}

function isMoving(robot: RobotSnapshot | null): boolean {
  const state = robot?.view.state?.state;
  return state === "moving" || state === "referencing";
}

function alarm(id: string, priority: Priority, values: Readonly<Record<string, string>> = NONE): Alarm {
  return { id, priority, values };
}
