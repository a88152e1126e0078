import { describe, expect, it } from "vitest";
import type { PlanView, ReadCase } from "../api/types";
import { planOfCase } from "./useCaseResults";

const READ = { view: { plans: 2 } } as unknown as ReadCase;
const plan = (number: number) => ({ number }) as unknown as PlanView;

describe("planOfCase", () => {
  it("is the newest one that the case has, and never the one before", () => {
    expect(planOfCase(READ, plan(2))).toEqual(plan(2));
    expect(planOfCase(READ, plan(1))).toBeNull();
    expect(planOfCase(READ, null)).toBeNull();
  });
});
