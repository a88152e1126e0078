import { useTranslation } from "react-i18next";
import type { VerificationView } from "../api/types";
import { percent } from "./Approval";
import { bound95Mm } from "./approval";

// Of the picture, in mm: its rings are drawn each millimetre.
const RINGS_MM = [1, 2, 3] as const;
const REACH_MM = 3.5;

interface Axis {
  readonly id: string;
  readonly entry_offset_mm: number;
  readonly exit_offset_mm: number;
  readonly angle_deg: number;
  readonly standard_uncertainty: { readonly entry_mm: number; readonly axis_deg: number };
  readonly chance_to_pass: number;
}

/** The newest verification as a target for each hole: how far entry and exit are from the axis of the nail's hole. */
export default function VerificationTarget({ verification }: { readonly verification: VerificationView }) {
  const { t } = useTranslation();
  const axes: readonly Axis[] =
    verification.of === "guide" ? (verification.guide_holes ?? []) : verification.wires;
  return (
    <section className="verification" aria-label={t("verify.title", { number: verification.number })}>
      <h3>{t("verify.title", { number: verification.number })}</h3>
      <p className={`verdict ${verification.verdict}`}>
        {t(`verify.${verification.verdict}`)} · {t(`verify.of_${verification.of ?? "wires"}`)}
      </p>
      {verification.reasons.map((reason) => (
        <p key={reason.code} className="refusal">
          {reason.message}
        </p>
      ))}
      <div className="targets">
        {axes.map((axis) => (
          <Target key={axis.id} axis={axis} />
        ))}
      </div>
    </section>
  );
}

function Target({ axis }: { readonly axis: Axis }) {
  const { t } = useTranslation();
  const rms = axis.standard_uncertainty.entry_mm;
  const bound = bound95Mm(axis.entry_offset_mm, rms);
  return (
    <figure className="target">
      <svg
        viewBox={`${-REACH_MM} ${-REACH_MM} ${2 * REACH_MM} ${2 * REACH_MM}`}
        role="img"
        aria-label={t("verify.target", { hole: axis.id })}
      >
        <title>{t("verify.target", { hole: axis.id })}</title>
        {RINGS_MM.map((radius) => (
          <circle key={radius} r={radius} className="target-ring" />
        ))}
        <circle r={Math.min(bound, REACH_MM)} className="target-bound" />
        <circle r={Math.min(axis.entry_offset_mm, REACH_MM)} className="target-entry" />
        <circle r={Math.min(axis.exit_offset_mm, REACH_MM)} className="target-exit" />
        <circle r={0.12} className="target-centre" />
      </svg>
      <figcaption>
        <strong>{axis.id}</strong>
        <span className="big">{percent(axis.chance_to_pass)}</span>
        <span>{t("verify.chance")}</span>
        <span className="entry-text">
          {t("verify.entry", { mm: axis.entry_offset_mm.toFixed(2), bound: bound.toFixed(2) })}
        </span>
        <span className="exit-text">{t("verify.exit", { mm: axis.exit_offset_mm.toFixed(2) })}</span>
        <span>{t("verify.angle", { deg: axis.angle_deg.toFixed(2) })}</span>
      </figcaption>
    </figure>
  );
}
