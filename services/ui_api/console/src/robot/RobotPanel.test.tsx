// @vitest-environment jsdom
import { cleanup, render, screen } from "@testing-library/react";
import { afterEach, beforeAll, describe, expect, it } from "vitest";
import type { RobotSnapshot } from "../api/types";
import { startLanguages } from "../languages";
import RobotPanel from "./RobotPanel";

const POSE = { x_mm: 0, y_mm: 0, z_mm: 0, u_deg: 0, v_deg: 0, w_deg: 0 };

function shown(changes: object) {
  const state = { state: "locked", locked: true, referenced: true, stop: "clear", pose: POSE, ...changes };
  const robot = { view: { state, age_s: 0.1 }, gotAtMs: 0 } as unknown as RobotSnapshot;
  render(<RobotPanel robot={robot} isLive />);
  return screen.getAllByRole("listitem").map((item) => item.textContent);
}

describe("RobotPanel", () => {
  beforeAll(startLanguages);
  afterEach(cleanup);

  it("shows brakes, reference and stop as the controller reports them", () => {
    expect(shown({})).toEqual(["✓ Locked", "✓ Referenced", "✓ No stop in force"]);
  });

  it("shows a robot that has lost its reference and is not locked", () => {
    const flags = shown({ state: "fault", locked: false, referenced: false, pose: null });
    expect(flags.slice(0, 2)).toEqual(["! Not locked", "! Not referenced"]);
  });

  it("does not show a robot as unlocked whose controller is slow to answer", () => {
    const flags = shown({ locked: false, referenced: false, pose: null });
    expect(flags).toEqual([
      "! The controller is slow to answer: brakes and reference are not known",
      "✓ No stop in force",
    ]);
  });
});
