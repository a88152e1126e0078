import { useState } from "react";
import { useTranslation } from "react-i18next";
import { act, useAct } from "../api/actions";
import type { Schemas } from "../api/client";
import { useSteps } from "../api/queries";
import type { ActionView, ReadCase } from "../api/types";
import ProblemNote from "../state/ProblemNote";
import { sentence } from "../state/sentence";
import Holes from "./Holes";

type StepBody = Schemas["StepBody"];

/** Record what people did with their hands: those in order first, the others with a reason. */
export default function Steps({ read }: { readonly read: ReadCase }) {
  const { t } = useTranslation();
  const [open, setOpen] = useState<string | null>(null);
  // Not the row's own: what was recorded moves to the other list while its row still waits for the answer.
  const recording = useAct((body: StepBody) => act.recordStep(read, body));
  const { steps, allowed_steps: inOrder, next_action: next } = read.view.procedure;
  const others = steps.filter((step) => step.verdict !== "allowed");
  const ordered = inOrder.flatMap((name) => steps.filter((step) => step.name === name));
  function toggle(name: string) {
    recording.reset();
    setOpen(open === name ? null : name);
  }
  const row = (step: ActionView) => (
    <StepRow
      key={step.name}
      step={step}
      read={read}
      isNext={step.name === next}
      isOpen={open === step.name}
      onToggle={() => toggle(step.name)}
      isSent={recording.isPending}
      error={recording.error}
      onRecord={(body) => recording.mutate(body, { onSuccess: () => setOpen(null) })}
    />
  );
  return (
    <section aria-label={t("procedure.steps")}>
      <h3>{t("procedure.steps")}</h3>
      <ul className="steps">{ordered.map(row)}</ul>
      {others.length > 0 && (
        <details>
          <summary>{t("procedure.other_steps")}</summary>
          <ul className="steps">{others.map(row)}</ul>
        </details>
      )}
      <Withdraw read={read} />
    </section>
  );
}

interface FormProps {
  readonly step: ActionView;
  readonly read: ReadCase;
  readonly isSent: boolean;
  readonly error: Error | null;
  readonly onRecord: (body: StepBody) => void;
}

interface RowProps extends FormProps {
  readonly isNext: boolean;
  readonly isOpen: boolean;
  readonly onToggle: () => void;
}

function StepRow({ isNext, isOpen, onToggle, ...form }: RowProps) {
  const { t } = useTranslation();
  const { step } = form;
  return (
    <li>
      <button
        type="button"
        className={isNext ? "primary wide" : "wide"}
        aria-expanded={isOpen}
        disabled={form.isSent}
        onClick={onToggle}
      >
        {t(`step.${step.name}`)}
      </button>
      {isOpen && step.verdict === "refused" && (
        <p className="refusal">
          {sentence(step.reason)} <em>{sentence(step.remedy)}</em>
        </p>
      )}
      {isOpen && step.verdict !== "refused" && <StepForm {...form} />}
    </li>
  );
}

function StepForm({ step, read, isSent, error, onRecord }: FormProps) {
  const { t } = useTranslation();
  const [holes, setHoles] = useState<string[]>([]);
  const [why, setWhy] = useState("");
  const needsReason = step.verdict === "with_reason";
  return (
    <div className="step-form">
      <Holes holeIds={read.view.hole_ids} chosen={holes} onChange={setHoles} isSent={isSent} />
      <p className="hint">{t("procedure.no_holes_means_all")}</p>
      {needsReason && (
        <label>
          {sentence(step.reason)} {t("procedure.why")}
          <input value={why} disabled={isSent} onChange={(event) => setWhy(event.target.value)} />
        </label>
      )}
      <button
        type="button"
        className="primary wide"
        disabled={isSent || (needsReason && why.trim() === "")}
        onClick={() => onRecord({ step: step.name as StepBody["step"], hole_ids: holes, why })}
      >
        {t("procedure.record", { step: t(`step.${step.name}`) })}
      </button>
      <ProblemNote error={error} />
    </div>
  );
}

/** The step that was recorded last, and the way to take it back where it was a mistake. */
function Withdraw({ read }: { readonly read: ReadCase }) {
  const { t } = useTranslation();
  const last = useSteps(read.view.id).data?.at(-1);
  const doing = useAct((number: number) => act.withdrawStep(read, number));
  const action = read.view.procedure.actions.find((one) => one.name === "withdraw_step");
  if (last === undefined || action?.verdict !== "allowed") return null;
  return (
    <div className="row">
      <span>
        {t("procedure.last_step", { step: t(`step.${last.step}`), holes: last.hole_ids.join(", ") })}
      </span>
      <button type="button" disabled={doing.isPending} onClick={() => doing.mutate(last.number)}>
        {t("action.withdraw_step")}
      </button>
      <ProblemNote error={doing.error} />
    </div>
  );
}
