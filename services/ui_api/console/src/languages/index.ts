import i18next from "i18next";
import { initReactI18next } from "react-i18next";
import english from "./en.json";
import { learn, type Sentences } from "./gateway";

/** Each in its own words. */
export const LANGUAGES: Readonly<Record<string, string>> = { en: "English", de: "Deutsch", zh: "中文" };
const KEPT_UNDER = "distalock-language";

type Loading<Words> = Promise<{ default: Words }>;

/** What the page says, and what the gateway says. */
const loaders: Readonly<Record<string, () => readonly [Loading<object>, Loading<Sentences>]>> = {
  de: () => [import("./de.json"), import("./gateway.de.json")],
  zh: () => [import("./zh.json"), import("./gateway.zh.json")],
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
  if (load !== undefined && !i18next.hasResourceBundle(code, "translation")) {
    const [page, gateway] = await Promise.all(load());
    learn(code, gateway.default);
    i18next.addResourceBundle(code, "translation", page.default);
  }
  await i18next.changeLanguage(code);
  document.documentElement.lang = code;
  localStorage.setItem(KEPT_UNDER, code);
}
