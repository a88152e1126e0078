import { useState } from "react";
import { useTranslation } from "react-i18next";
import { useCases } from "../api/queries";
import { useWhen } from "../languages/useWhen";
import { casePath } from "../state/place";

const FILTERS = ["all", "open", "closed"] as const;
type Filter = (typeof FILTERS)[number];

/** All cases, the newest first. */
export default function Cases() {
  const { t } = useTranslation();
  const when = useWhen();
  const [filter, setFilter] = useState<Filter>("all");
  const cases = useCases(filter === "all" ? null : filter);
  return (
    <main className="page-view">
      <h1>{t("records.cases")}</h1>
      <fieldset className="row choices">
        <legend>{t("records.filter")}</legend>
        {FILTERS.map((name) => (
          <button key={name} type="button" aria-pressed={filter === name} onClick={() => setFilter(name)}>
            {t(`records.filters.${name}`)}
          </button>
        ))}
      </fieldset>
      <table>
        <thead>
          <tr>
            <th scope="col">{t("records.case")}</th>
            <th scope="col">{t("records.opened")}</th>
            <th scope="col">{t("records.what")}</th>
            <th scope="col">{t("records.stage")}</th>
            <th scope="col">{t("records.counts")}</th>
          </tr>
        </thead>
        <tbody>
          {cases.data?.items.map((one) => (
            <tr key={one.id}>
              <th scope="row">
                <a href={casePath(one.id)}>{one.id}</a>
              </th>
              <td>{when(one.opened_at_ns)}</td>
              <td>
                {t(`case.side.${one.side}`)} {t(`case.bone.${one.bone}`)}, {one.nail.name}
              </td>
              <td>{t(`stage.${one.procedure.stage}`)}</td>
              <td>
                {t("records.count_line", {
                  images: one.images,
                  plans: one.plans,
                  motions: one.motions.length,
                  verifications: one.verifications,
                })}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
      {cases.data?.items.length === 0 && <p className="empty">{t("records.none")}</p>}
    </main>
  );
}
