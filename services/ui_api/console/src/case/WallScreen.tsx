import { useTranslation } from "react-i18next";
import type { ReadCase, RobotSnapshot } from "../api/types";
import { PlanFigures } from "../procedure/Approval";
import VerificationTarget from "../procedure/VerificationTarget";
import { sentence } from "../state/sentence";
import CaseLine from "./CaseLine";
import Pictures from "./Pictures";
import { useCaseResults } from "./useCaseResults";

interface Props {
  readonly read: ReadCase;
  readonly robot: RobotSnapshot | null;
  readonly isLive: boolean;
}

/** A second screen for the whole team: everything to be seen, nothing to be done. */
export default function WallScreen({ read, robot, isLive }: Props) {
  const { t } = useTranslation();
  const results = useCaseResults(read, robot, isLive);
  const { plan, verification } = results;
  const { procedure } = read.view;
  const isPlanned = plan !== null && plan.validity === "current";
  return (
    <main className="room wall">
      <h1 className="unseen">{t("nav.wall")}</h1>
      <CaseLine view={read.view} />
      <section className="wall-words" aria-label={t("procedure.title")} data-phase={procedure.phase}>
        <h2 className="quiet">{t("procedure.next")}</h2>
        <p className="next" aria-live="polite">
          {sentence(procedure.next)}
        </p>
        {isPlanned && (
          <>
            <h2>{t("wall.plan", { plan: plan.number })}</h2>
            <PlanFigures read={read} plan={plan} />
          </>
        )}
        {verification && <VerificationTarget verification={verification} />}
      </section>
      <Pictures {...results} />
    </main>
  );
}
