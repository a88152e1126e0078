import { useState } from "react";
import { useTranslation } from "react-i18next";
import { act, useAct } from "../api/actions";
import type { ActionView, LocalisationView, Me, PlanView, ReadCase } from "../api/types";
import ProblemNote from "../state/ProblemNote";
import { sentence } from "../state/sentence";
import Approval from "./Approval";
import Holes from "./Holes";
import SetUpForm from "./SetUpForm";
import VerifyForm from "./VerifyForm";

export interface ActionProps {
  readonly action: ActionView;
  readonly read: ReadCase;
  readonly me: Me;
  readonly plan: PlanView | null;
  readonly localisation: LocalisationView | null;
}

/** What is needed to take one action; where it may not be taken, why and what to do. */
export default function ActionForm(props: ActionProps) {
  const { t } = useTranslation();
  const { action, me } = props;
  if (action.verdict === "refused" && action.refused_by === "gateway")
    return (
      <p className="refusal">
        {sentence(action.reason)} <em>{sentence(action.remedy)}</em>
      </p>
    );
  if (!action.roles.some((role) => me.roles.includes(role)))
    return (
      <p className="refusal">
        {t("procedure.not_your_role", { roles: action.roles.map((r) => t(`role.${r}`)).join(", ") })}
      </p>
    );
  return <Form {...props} />;
}

function Form({ action, read, me, plan, localisation }: ActionProps) {
  const { t } = useTranslation();
  switch (action.name) {
    case "take_image":
      return <p className="hint">{t("procedure.pedal")}</p>;
    case "request_plan":
      return localisation && <PlanForm read={read} localisation={localisation} />;
    case "approve_plan":
      return plan && <Approval read={read} plan={plan} me={me} />;
    case "withdraw_approval":
      return plan && <Simple name={action.name} run={() => act.withdrawApproval(read, plan.number)} />;
    case "verify":
      return <VerifyForm read={read} />;
    case "change_setup":
      return <SetUpForm read={read} />;
    case "acknowledge_stop":
      return <Simple name={action.name} run={act.acknowledgeStop} />;
    case "reference":
      return <Simple name={action.name} run={act.reference} isDeliberate />;
    case "reset":
      return <Simple name={action.name} run={act.reset} isDeliberate />;
    default:
      // Moving, stopping and recording steps have places of their own.
      return null;
  }
}

interface SimpleProps {
  readonly name: string;
  readonly run: () => Promise<unknown>;
  /** Asked once more, because something moves. */
  readonly isDeliberate?: boolean;
}

/** An action that needs nothing but the wish. */
export function Simple({ name, run, isDeliberate = false }: SimpleProps) {
  const { t } = useTranslation();
  const doing = useAct(run);
  const [isAsking, setAsking] = useState(false);
  function press() {
    if (isDeliberate && !isAsking) return setAsking(true);
    setAsking(false);
    return doing.mutate(undefined);
  }
  return (
    <div>
      {isAsking && <p className="hint">{t(`action.${name}_asks`)}</p>}
      <div className="row">
        <button type="button" className="primary" disabled={doing.isPending} onClick={press}>
          {isAsking ? t("procedure.yes") : t(`action.${name}`)}
        </button>
        {isAsking && (
          <button type="button" onClick={() => setAsking(false)}>
            {t("procedure.no")}
          </button>
        )}
      </div>
      <ProblemNote error={doing.error} />
    </div>
  );
}

function PlanForm({
  read,
  localisation,
}: {
  readonly read: ReadCase;
  readonly localisation: LocalisationView;
}) {
  const { t } = useTranslation();
  const left = read.view.hole_ids.filter((hole) => !read.view.procedure.drilled_hole_ids.includes(hole));
  const [chosen, setChosen] = useState<string[]>([...left]);
  const doing = useAct(() => act.requestPlan(read, { localisation: localisation.number, hole_ids: chosen }));
  return (
    <div>
      <Holes holeIds={read.view.hole_ids} chosen={chosen} onChange={setChosen} isSent={doing.isPending} />
      <button
        type="button"
        className="primary wide"
        disabled={doing.isPending || chosen.length === 0}
        onClick={() => doing.mutate(undefined)}
      >
        {t(doing.isPending ? "procedure.planning" : "action.request_plan")}
      </button>
      <ProblemNote error={doing.error} />
    </div>
  );
}
