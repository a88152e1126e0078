import i18next from "i18next";
import { initReactI18next } from "react-i18next";
import english from "./en.json";

/** Begin with English; other languages are loaded when they are chosen. */
export async function startLanguages(): Promise<void> {
  await i18next.use(initReactI18next).init({
    lng: "en",
    fallbackLng: "en",
    resources: { en: { translation: english } },
    interpolation: { escapeValue: false }, // React escapes
    returnNull: false,
  });
}
