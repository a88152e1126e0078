import { useTranslation } from "react-i18next";
import { useCase, useQaReports, useTimeline, useVerifications } from "../api/queries";
import type { TimelineEntry } from "../api/types";
import Thumbnail from "../image/Thumbnail";
import { useWhen } from "../languages/useWhen";
import ProblemNote from "../state/ProblemNote";
import { sentence } from "../state/sentence";
import Bars, { type Bar } from "./Bars";
import Residuals from "./Residuals";

const THUMBNAIL_PX = 240;

/** One case: what happened, with pictures, the errors that were verified, and the C-arm's drift. It prints as a report. */
export default function CaseRecord({ id }: { readonly id: string }) {
  const { t } = useTranslation();
  const when = useWhen();
  const read = useCase(id);
  const timeline = useTimeline(id);
  if (read.error) return <ProblemNote error={read.error} />;
  const view = read.data?.view;
  if (view === undefined) return null;
  return (
    <main className="page-view record">
      <div className="row no-print">
        <a href="#/cases">{t("records.back")}</a>
        <button type="button" onClick={() => globalThis.print()}>
          {t("records.print")}
        </button>
      </div>
      <h1>
        {t("records.case")} {view.id}
      </h1>
      <p className="research">{t("records.research")}</p>
      <dl className="facts">
        <Fact name={t("records.opened")}>{when(view.opened_at_ns)}</Fact>
        <Fact name={t("case.side.title")}>
          {t(`case.side.${view.side}`)} {t(`case.bone.${view.bone}`)}
        </Fact>
        <Fact name={t("records.stage")}>{t(`stage.${view.procedure.stage}`)}</Fact>
        <Fact name={t("case.nail")}>{view.nail.name}</Fact>
        <Fact name={t("case.guide")}>{view.guide.name}</Fact>
        <Fact name={t("case.ring")}>{view.ring.name}</Fact>
        <Fact name={t("records.drilled")}>{view.procedure.drilled_hole_ids.join(", ") || "–"}</Fact>
      </dl>
      <VerifiedErrors id={id} />
      <Residuals caseId={id} />
      <Drift id={id} />
      <h2>{t("records.timeline")}</h2>
      <ol className="timeline">
        {timeline.data?.map((entry) => (
          <Entry key={entry.sequence} entry={entry} />
        ))}
      </ol>
      <ProblemNote error={timeline.error} />
    </main>
  );
}

function Fact({ name, children }: { readonly name: string; readonly children: React.ReactNode }) {
  return (
    <div>
      <dt>{name}</dt>
      <dd>{children}</dd>
    </div>
  );
}

function Entry({ entry }: { readonly entry: TimelineEntry }) {
  const { t } = useTranslation();
  const when = useWhen();
  return (
    <li className={entry.kind}>
      <time dateTime={entry.at}>{when(entry.at_ns)}</time>
      <div>
        <p>{sentence(entry.what)}</p>
        {entry.why && <p className="hint">{sentence(entry.why)}</p>}
        <p className="hint">{entry.who}</p>
      </div>
      {entry.picture && (
        <Thumbnail
          address={entry.picture}
          width_px={THUMBNAIL_PX}
          alt={t("records.picture", { number: entry.sequence })}
        />
      )}
    </li>
  );
}

function VerifiedErrors({ id }: { readonly id: string }) {
  const { t } = useTranslation();
  const verifications = useVerifications(id).data ?? [];
  const bars: readonly Bar[] = verifications.flatMap((one) =>
    (one.of === "guide" ? (one.guide_holes ?? []) : one.wires).map((axis) => ({
      label: `${one.number} ${axis.id}`,
      value: axis.entry_offset_mm,
      uncertainty: axis.standard_uncertainty.entry_mm,
      isGood: one.verdict === "accepted",
    })),
  );
  return bars.length === 0 ? null : <Bars title={t("records.errors")} unit="mm" bars={bars} />;
}

function Drift({ id }: { readonly id: string }) {
  const { t } = useTranslation();
  const reports = useQaReports(id).data ?? [];
  const bars: readonly Bar[] = reports.flatMap((report) =>
    report.drift === null
      ? []
      : [
          {
            label: String(report.number),
            value: report.drift.worst_ball_mm,
            uncertainty: 0,
            isGood: report.verdict === "good",
          },
        ],
  );
  return bars.length === 0 ? null : <Bars title={t("records.drift")} unit="mm" bars={bars} />;
}
