import { useTranslation } from "react-i18next";
import { act } from "../api/actions";
import type { Me, RobotSnapshot } from "../api/types";
import { Simple } from "../procedure/ActionForm";
import { sentence } from "../state/sentence";

const RUN = { acknowledge_stop: act.acknowledgeStop, reference: act.reference, reset: act.reset } as const;

/** What can be done with the robot while no case is open; what not, and why. */
export default function RobotActions({
  robot,
  me,
}: {
  readonly robot: RobotSnapshot | null;
  readonly me: Me;
}) {
  const { t } = useTranslation();
  const actions = (robot?.view.actions ?? []).filter((action) => action.name in RUN);
  return (
    <section className="robot-actions" aria-label={t("robot.actions")}>
      {actions.map((action) =>
        action.verdict === "allowed" && action.roles.some((role) => me.roles.includes(role)) ? (
          <Simple
            key={action.name}
            name={action.name}
            run={RUN[action.name as keyof typeof RUN]}
            isDeliberate={action.name !== "acknowledge_stop"}
          />
        ) : (
          <p key={action.name} className="refusal">
            <strong>{t(`action.${action.name}`)}</strong>: {sentence(action.reason)}{" "}
            <em>{sentence(action.remedy)}</em>
          </p>
        ),
      )}
    </section>
  );
}
