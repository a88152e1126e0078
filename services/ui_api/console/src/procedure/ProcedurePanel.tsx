import { useState } from "react";
import { useTranslation } from "react-i18next";
import type { LocalisationView, Me, PlanView, ReadCase, VerificationView } from "../api/types";
import { sentence } from "../state/sentence";
import ActionForm from "./ActionForm";
import CheckList from "./CheckList";
import HoldToMove from "./HoldToMove";
import Steps from "./Steps";
import { useHold } from "./useHold";
import VerificationTarget from "./VerificationTarget";
import WhyNot from "./WhyNot";

interface Props {
  readonly read: ReadCase;
  readonly me: Me;
  readonly plan: PlanView | null;
  readonly localisation: LocalisationView | null;
  readonly verification: VerificationView | null;
}

// These have places of their own: the button to hold, the stop, the steps.
const ELSEWHERE: ReadonlySet<string> = new Set(["start_motion", "stop", "record_step", "withdraw_step"]);
const CHECKED_IN = { set_up: "set_up", drilling: "before_drilling" } as const;

/** What is next, what else may be done, what not and why: all of it as the case says it. */
export default function ProcedurePanel({ read, me, plan, localisation, verification }: Props) {
  const { t } = useTranslation();
  const { procedure } = read.view;
  const hold = useHold(read, plan);
  const next = procedure.actions.find((action) => action.name === procedure.next_action);
  const others = procedure.actions.filter(
    (action) => action.verdict === "allowed" && action !== next && !ELSEWHERE.has(action.name),
  );
  const motion = procedure.actions.find((action) => action.name === "start_motion");
  const mayMove = motion?.verdict === "allowed" && motion.roles.some((role) => me.roles.includes(role));
  const list = CHECKED_IN[procedure.phase as keyof typeof CHECKED_IN];
  const forms = { read, me, plan, localisation };
  return (
    <section
      className="procedure"
      aria-label={t("procedure.title")}
      data-phase={procedure.phase}
      data-next={procedure.next_action ?? ""}
    >
      <h2 className="quiet">{t("procedure.next")}</h2>
      <p className="next" aria-live="polite">
        {sentence(procedure.next)}
      </p>
      {list && <CheckList key={`${list} ${read.view.revision}`} name={list} />}
      <HoldToMove hold={hold} isAllowed={mayMove} />
      {next && !ELSEWHERE.has(next.name) && <ActionForm key={next.name} action={next} {...forms} />}
      {verification && <VerificationTarget verification={verification} />}
      <Steps read={read} />
      {others.map((action) => (
        <Other key={action.name} title={t(`action.${action.name}`)}>
          <ActionForm action={action} {...forms} />
        </Other>
      ))}
      <WhyNot actions={procedure.actions} />
    </section>
  );
}

function Other({ title, children }: { readonly title: string; readonly children: React.ReactNode }) {
  const [isOpen, setOpen] = useState(false);
  return (
    <div className="other">
      <button type="button" className="wide" aria-expanded={isOpen} onClick={() => setOpen(!isOpen)}>
        {title}
      </button>
      {isOpen && children}
    </div>
  );
}
