import { useTranslation } from "react-i18next";
import { useReadiness, useRobot, useVersion } from "../api/queries";
import ProblemNote from "../state/ProblemNote";
import { sentence } from "../state/sentence";

/** What each part of the installation does, what was measured, and what to do where it is not as it should be. */
export default function Service() {
  const { t } = useTranslation();
  const checks = useReadiness();
  const version = useVersion();
  const robot = useRobot(true).data?.view;
  return (
    <main className="page-view">
      <h1>{t("service.title")}</h1>
      <table>
        <thead>
          <tr>
            <th scope="col">{t("service.part")}</th>
            <th scope="col">{t("service.state")}</th>
            <th scope="col">{t("service.measured")}</th>
            <th scope="col">{t("service.remedy")}</th>
          </tr>
        </thead>
        <tbody>
          {checks.data?.map((check) => (
            <tr key={check.name}>
              <th scope="row">{t(`part.${check.name}`, check.name)}</th>
              <td className={check.ok ? "good" : "attention"}>
                {t(check.ok ? "service.well" : "service.not_well")}
              </td>
              <td>{sentence(check.measured)}</td>
              <td>{sentence(check.remedy)}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <ProblemNote error={checks.error} />
      <p className="hint">
        {t("service.doctor")} <code>distalock doctor</code>
      </p>
      <dl className="facts">
        <div>
          <dt>{t("service.version")}</dt>
          <dd>{version.data}</dd>
        </div>
        <div>
          <dt>{t("service.controller")}</dt>
          <dd>{robot?.state?.controller_identity ?? "–"}</dd>
        </div>
        <div>
          <dt>{t("service.image_source")}</dt>
          <dd>{robot?.image_source ?? "–"}</dd>
        </div>
      </dl>
    </main>
  );
}
