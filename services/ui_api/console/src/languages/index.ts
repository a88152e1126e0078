import i18next from "i18next";
import { initReactI18next } from "react-i18next";
import english from "./en.json";

/** Each in its own words. */
export const LANGUAGES: Readonly<Record<string, string>> = { en: "English", de: "Deutsch", zh: "中文" };
const KEPT_UNDER = "distalock-language";

const loaders: Readonly<Record<string, () => Promise<{ default: object }>>> = {
  de: () => import("./de.json"),
  zh: () => import("./zh.json"),
};

/** Begin with the language that was chosen on this machine, else with the browser's, else with English. */
export async function startLanguages(): Promise<void> {
  await i18next.use(initReactI18next).init({
    lng: "en",
    fallbackLng: "en",
    resources: { en: { translation: english } },
    interpolation: { escapeValue: false }, // React escapes
    returnNull: false,
  });
  const wanted = localStorage.getItem(KEPT_UNDER) ?? navigator.language.split("-")[0] ?? "en";
  if (wanted in LANGUAGES) await speak(wanted);
}

/** Change the page's language. */
export async function speak(code: string): Promise<void> {
  const load = loaders[code];
  if (load !== undefined && !i18next.hasResourceBundle(code, "translation"))
    i18next.addResourceBundle(code, "translation", (await load()).default);
  await i18next.changeLanguage(code);
  document.documentElement.lang = code;
  localStorage.setItem(KEPT_UNDER, code);
}
