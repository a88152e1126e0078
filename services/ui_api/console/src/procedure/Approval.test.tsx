// @vitest-environment jsdom
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeAll, describe, expect, it } from "vitest";
import type { Me, PlanView, ReadCase } from "../api/types";
import { startLanguages } from "../languages";
import Approval, { percent } from "./Approval";

const READ = { view: { id: "case-1", side: "right", bone: "tibia" }, etag: '"1-a"' } as unknown as ReadCase;
const ME = { name: "ada", roles: ["surgeon"] } as unknown as Me;

function plan(sha256: string): PlanView {
  const predicted = [
    {
      id: "distal",
      offset_mm: 0.3,
      angle_deg: 0.5,
      chance_to_pass: 0.9996,
      standard_uncertainty: { entry_mm: 0.1, axis_deg: 0.1 },
    },
  ];
  return {
    number: 7,
    sha256,
    plan: { hole_ids: ["distal"], travel_mm: 4.26, travel_deg: 1.5, predicted },
  } as unknown as PlanView;
}

function shown(of: PlanView) {
  return (
    <QueryClientProvider client={new QueryClient()}>
      <Approval read={READ} plan={of} me={ME} />
    </QueryClientProvider>
  );
}

describe("Approval", () => {
  beforeAll(startLanguages);
  afterEach(cleanup);

  it("shows side, holes, travel, error, bound and chance before anything is asked", () => {
    const { container } = render(shown(plan("a")));
    const text = container.textContent ?? "";
    for (const wanted of ["RIGHT", "tibia", "distal", "4.3 mm", "1.5°", "0.30 mm", "0.47 mm", "> 99.9 %"])
      expect(text).toContain(wanted);
    expect(container.querySelector("input")).toBeNull();
  });

  it("takes the first act back when another plan comes", () => {
    const { container, rerender } = render(shown(plan("a")));
    fireEvent.click(screen.getByRole("button", { name: /^1 / }));
    expect(container.querySelector("input[type=password]")).not.toBeNull();
    rerender(shown(plan("b")));
    expect(container.querySelector("input")).toBeNull();
  });
});

describe("percent", () => {
  it("never says that a chance is certain, nor better than it is", () => {
    expect(percent(1)).toBe("> 99.9 %");
    expect(percent(0.98999)).toBe("98.9 %");
  });
});
