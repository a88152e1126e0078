import { useTranslation } from "react-i18next";
import type { ActionView } from "../api/types";
import { sentence } from "../state/sentence";

/** Every action that is refused now: why, and what to do about it. */
export default function WhyNot({ actions }: { readonly actions: readonly ActionView[] }) {
  const { t } = useTranslation();
  const refused = actions.filter((action) => action.verdict === "refused");
  return (
    <details className="why-not">
      <summary>{t("procedure.why_not", { count: refused.length })}</summary>
      <dl>
        {refused.map((action) => (
          <div key={action.name}>
            <dt>{t(`action.${action.name}`)}</dt>
            <dd>
              {sentence(action.reason)} <em>{sentence(action.remedy)}</em>
            </dd>
          </div>
        ))}
      </dl>
    </details>
  );
}
