import { useTranslation } from "react-i18next";
import type { Procedure } from "../api/types";

const SIGNS = { done: "✓", now: "▶", to_come: "" } as const;

/** One line of phases: done, now, to come. */
export default function PhaseLine({ procedure }: { readonly procedure: Procedure }) {
  const { t } = useTranslation();
  return (
    <ol className="phases" aria-label={t("procedure.line")}>
      {procedure.line.map((phase) => (
        <li
          key={phase.name}
          className={phase.status}
          aria-current={phase.status === "now" ? "step" : undefined}
        >
          <span aria-hidden="true">{SIGNS[phase.status]}</span> {t(`phase.${phase.name}`)}
          <span className="unseen"> {t(`procedure.${phase.status}`)}</span>
        </li>
      ))}
    </ol>
  );
}
