import { useTranslation } from "react-i18next";
import type { RobotSnapshot, RobotState } from "../api/types";
import { ageNow } from "../state/connection";
import { useNow } from "../state/useNow";

interface Props {
  readonly robot: RobotSnapshot | null;
  readonly isLive: boolean;
}

const DIGITS = 2;

/** The robot as it last said it was, with the age of that. What is not live is greyed, struck through, and named so. */
export default function RobotPanel({ robot, isLive }: Props) {
  const { t } = useTranslation();
  const now = useNow();
  const state = robot?.view.state;
  if (!robot || !state) return <p className="empty">{t("robot.none")}</p>;
  const age = ageNow(robot.view.age_s, robot.gotAtMs, now);
  return (
    <section className={isLive ? "robot" : "robot not-live"} aria-label={t("robot.title")}>
      <h2>
        <span className={`lamp ${isLive ? state.state : "unknown"}`} aria-hidden="true" />
        {isLive
          ? t(`robot.state.${state.state}`)
          : t("robot.not_live", { state: t(`robot.state.${state.state}`) })}
        <small>{age === null ? t("robot.age_unknown") : t("robot.age", { s: age.toFixed(1) })}</small>
      </h2>
      <Flags state={state} />
      {state.pose && (
        <dl className="pose">
          {Object.entries(state.pose).map(([name, value]) => (
            <div key={name}>
              <dt>{t(`scene.pose.${name}`)}</dt>
              <dd>{value.toFixed(DIGITS)}</dd>
            </div>
          ))}
        </dl>
      )}
      {state.detail && <p className="hint">{state.detail}</p>}
    </section>
  );
}

function Flags({ state }: { readonly state: RobotState }) {
  const { t } = useTranslation();
  return (
    <ul className="flags">
      {isUnanswered(state) ? (
        <Flag good={false}>{t("robot.unanswered")}</Flag>
      ) : (
        <>
          <Flag good={state.locked}>{t(state.locked ? "robot.locked" : "robot.not_locked")}</Flag>
          <Flag good={state.referenced}>
            {t(state.referenced ? "robot.referenced" : "robot.not_referenced")}
          </Flag>
        </>
      )}
      <Flag good={state.stop === "clear"}>{t(`robot.stop.${state.stop}`)}</Flag>
      {state.stop_button !== undefined && (
        <Flag good={state.stop_button !== "pressed" && state.stop_button !== "released"}>
          {t(`robot.stop_button.${state.stop_button}`)}
        </Flag>
      )}
    </ul>
  );
}

/** Whether the controller is slow to answer: neither brakes nor reference are known then, and nothing has changed. */
function isUnanswered(state: RobotState): boolean {
  return (state.state === "locked" || state.state === "stopped") && state.pose === null;
}

function Flag({ good, children }: { readonly good: boolean; readonly children: React.ReactNode }) {
  return (
    <li className={good ? "good" : "attention"}>
      <span aria-hidden="true">{good ? "✓" : "!"}</span> {children}
    </li>
  );
}
