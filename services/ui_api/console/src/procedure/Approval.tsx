import { useQueryClient } from "@tanstack/react-query";
import { type FormEvent, useEffect, useReducer } from "react";
import { useTranslation } from "react-i18next";
import { hasPasskeys, signedByPasskey } from "../access/webauthn";
import { act } from "../api/actions";
import { ApiError } from "../api/client";
import { CASE, ME, usePasskeys } from "../api/queries";
import type { Me, PlanView, ReadCase } from "../api/types";
import { approvalReducer, bound95Mm, PASSKEY_NOT_GIVEN, startApproval } from "./approval";

interface Props {
  readonly read: ReadCase;
  readonly plan: PlanView;
  readonly me: Me;
}

/** Look at the plan, say that it was checked, then approve it with the credential. */
export default function Approval({ read, plan, me }: Props) {
  const { t } = useTranslation();
  const client = useQueryClient();
  const [state, dispatch] = useReducer(approvalReducer, plan.sha256, startApproval);
  const hasPasskey = (usePasskeys(hasPasskeys()).data ?? []).length > 0;
  useEffect(() => dispatch({ kind: "plan", plan: plan.sha256 }), [plan.sha256]);

  function withPassword(event: FormEvent<HTMLFormElement>) {
    event.preventDefault();
    const password = String(new FormData(event.currentTarget).get("credential"));
    void approve(() => act.approvePlan(read, plan, { password }));
  }

  async function withPasskey() {
    const challenge = await act.passkeyChallenge(plan);
    const passkey = await signedByPasskey(challenge.public_key);
    await act.approvePlan(read, plan, { passkey });
  }

  async function approve(send: () => Promise<unknown>) {
    dispatch({ kind: "sent" });
    try {
      await send();
    } catch (error) {
      const problem = problemOf(error, t("approval.passkey_not_given"));
      dispatch({ kind: "failed", code: problem.code, detail: problem.detail });
      // A session that has ended shows the sign-in; the plan is as it was, and nobody has approved it.
      if (problem.status === 401) void client.invalidateQueries({ queryKey: [ME] });
    }
    await client.invalidateQueries({ queryKey: [CASE] });
  }

  return (
    <section className="approval" aria-label={t("approval.title", { plan: plan.number })}>
      <h3>{t("approval.title", { plan: plan.number })}</h3>
      <PlanFigures read={read} plan={plan} />
      {state.detail !== "" && (
        <p className="problem" role="alert">
          {state.code === "no_answer" ? t("state.no_answer") : state.detail}
        </p>
      )}
      {state.phase === "reviewing" ? (
        <button type="button" className="primary wide" onClick={() => dispatch({ kind: "checked" })}>
          {t("approval.first_act")}
        </button>
      ) : (
        <form onSubmit={withPassword}>
          {hasPasskey && (
            <button
              type="button"
              className="primary wide"
              disabled={state.phase === "sending"}
              onClick={() => void approve(withPasskey)}
            >
              {t("approval.second_act_passkey")}
            </button>
          )}
          <label>
            {t("approval.credential", { name: me.name })}
            <input name="credential" type="password" autoComplete="off" required />
          </label>
          <div className="row">
            <button
              type="submit"
              className={hasPasskey ? "" : "primary"}
              disabled={state.phase === "sending"}
            >
              {t("approval.second_act")}
            </button>
            <button type="button" onClick={() => dispatch({ kind: "back" })}>
              {t("approval.back")}
            </button>
          </div>
        </form>
      )}
    </section>
  );
}

/** What is said of an attempt that failed; a browser that got no passkey tells no reason. */
function problemOf(error: unknown, passkeyNotGiven: string): ApiError {
  if (error instanceof ApiError) return error;
  if (error instanceof DOMException) return new ApiError(0, PASSKEY_NOT_GIVEN, passkeyNotGiven);
  return new ApiError(0, "no_answer", String(error));
}

/** Side, holes, travel, and the predicted error of each hole with its bound and the chance to pass. */
export function PlanFigures({ read, plan }: { readonly read: ReadCase; readonly plan: PlanView }) {
  const { t } = useTranslation();
  const { travel_mm, travel_deg, hole_ids, predicted } = plan.plan;
  return (
    <>
      <p className="side">
        {t(`case.side.${read.view.side}`)} {t(`case.bone.${read.view.bone}`)} · {hole_ids.join(", ")}
      </p>
      <p className="figure">
        {t("approval.travel", { mm: travel_mm.toFixed(1), deg: travel_deg.toFixed(1) })}
      </p>
      <table className="figures">
        <thead>
          <tr>
            <th scope="col">{t("approval.hole")}</th>
            <th scope="col">{t("approval.error")}</th>
            <th scope="col">{t("approval.chance")}</th>
          </tr>
        </thead>
        <tbody>
          {predicted.map((hole) => (
            <tr key={hole.id}>
              <th scope="row">{hole.id}</th>
              <td>
                {hole.offset_mm.toFixed(2)} mm, {hole.angle_deg.toFixed(2)}°
                <br />
                {t("approval.bound")}{" "}
                <strong>{bound95Mm(hole.offset_mm, hole.standard_uncertainty.entry_mm).toFixed(2)} mm</strong>
              </td>
              <td>{percent(hole.chance_to_pass)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </>
  );
}

/** A chance in percent; never rounded up to certainty. */
export function percent(chance: number): string {
  if (chance > 0.999) return "> 99.9 %";
  return `${(Math.floor(chance * 1000) / 10).toFixed(1)} %`;
}
