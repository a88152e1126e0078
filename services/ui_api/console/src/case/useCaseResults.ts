import { useNewestImage, useNewestLocalisation, useNewestPlan, useNewestVerification } from "../api/queries";
import type { PlanView, ReadCase, RobotSnapshot } from "../api/types";
import type { ImagePanelProps } from "../panels";

/** The newest of everything that a case has, as the panels take it. */
export function useCaseResults(
  read: ReadCase,
  robot: RobotSnapshot | null,
  isLive: boolean,
): ImagePanelProps {
  const id = read.view.id;
  return {
    caseView: read.view,
    newestImage: useNewestImage(id).data ?? null,
    localisation: useNewestLocalisation(id).data ?? null,
    plan: planOfCase(read, useNewestPlan(id).data ?? null),
    verification: useNewestVerification(id).data ?? null,
    robot,
    isLive,
  };
}

/** The plan that the case means. Right after one was made the plan before it may still be here: nobody approves that. */
export function planOfCase(read: ReadCase, plan: PlanView | null): PlanView | null {
  return plan?.number === read.view.plans ? plan : null;
}
