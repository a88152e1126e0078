import { useTranslation } from "react-i18next";
import { LANGUAGES, speak } from "./index";

/** The page's language. It is kept on this machine, for it says nothing of anybody. */
export default function LanguageChoice() {
  const { t, i18n } = useTranslation();
  return (
    <select
      aria-label={t("languages.choose")}
      value={i18n.language}
      onChange={(event) => void speak(event.target.value)}
    >
      {Object.entries(LANGUAGES).map(([code, name]) => (
        <option key={code} value={code} lang={code}>
          {name}
        </option>
      ))}
    </select>
  );
}
