import { useTranslation } from "react-i18next";
import type { ReadCase } from "../api/types";

interface Props {
  readonly read: ReadCase;
}

/** What is next, and every action with its reason and remedy, as the case says them. */
export default function ProcedurePanel({ read }: Props) {
  const { t } = useTranslation();
  const { procedure } = read.view;
  return (
    <section className="procedure" aria-label={t("procedure.title")}>
      <h2>{t("procedure.next")}</h2>
      <p className="next">{procedure.next}</p>
      <h2>{t("procedure.actions")}</h2>
      <ul className="actions">
        {procedure.actions.map((action) => (
          <li key={action.name} className={action.verdict}>
            <strong>{t(`action.${action.name}`, action.name)}</strong>
            {action.reason && (
              <p>
                {action.reason}; {action.remedy}
              </p>
            )}
          </li>
        ))}
      </ul>
    </section>
  );
}
