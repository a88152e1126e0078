import { describe, expect, it } from "vitest";
import type { RobotSnapshot } from "../api/types";
import { alarmsOf, type Known } from "./alarms";

function robot(state: string, changes: object = {}, view: object = {}): RobotSnapshot {
  const said = { state, stop: "clear", locked: true, referenced: true, detail: "", ...changes };
  return { view: { state: said, validity: "current", ...view }, gotAtMs: 0 } as unknown as RobotSnapshot;
}

const WELL: Known = {
  connection: "live",
  robot: robot("locked"),
  checks: [],
  stopNotConfirmed: false,
  hasCase: true,
};

function said(changes: Partial<Known>): string[] {
  return alarmsOf({ ...WELL, ...changes }).map((alarm) => `${alarm.priority} ${alarm.id}`);
}

describe("alarmsOf", () => {
  it("says nothing when all is well", () => {
    expect(said({})).toEqual([]);
  });

  it("is urgent when the gateway or the robot falls silent while something moves", () => {
    expect(said({ connection: "lost" })).toEqual(["medium lost"]);
    expect(said({ connection: "lost", robot: robot("moving") })).toEqual(["high lost_in_motion"]);
    expect(said({ robot: robot("locked", {}, { validity: "stale" }) })).toEqual(["medium robot_silent"]);
    expect(said({ robot: robot("moving", {}, { validity: "stale" }) })).toEqual([
      "high robot_silent_in_motion",
    ]);
  });

  it("puts the most urgent first", () => {
    const check = { name: "imaging", ok: false, code: "absent", measured: "m", remedy: "r" };
    expect(said({ robot: robot("fault", { stop: "latched" }), checks: [check] })).toEqual([
      "high robot_fault",
      "medium not_ready",
      "low stop_in_force",
    ]);
  });

  it("says of a pressed button once what it is", () => {
    expect(said({ robot: robot("stopped", { stop: "latched", stop_button: "pressed" }) })).toEqual([
      "medium stop_button_pressed",
    ]);
  });

  it("does not repeat what was last known as if it held, when the gateway is gone", () => {
    const check = { name: "imaging", ok: false, code: "absent", measured: "m", remedy: "r" };
    expect(said({ connection: "lost", robot: robot("fault"), checks: [check] })).toEqual(["medium lost"]);
  });
});
