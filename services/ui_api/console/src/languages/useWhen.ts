import { useTranslation } from "react-i18next";

/** Nanoseconds since 1970 as date and time of day, as the page's language writes them. */
export function useWhen(): (ns: number) => string {
  const { i18n } = useTranslation();
  const format = new Intl.DateTimeFormat(i18n.language, { dateStyle: "medium", timeStyle: "medium" });
  return (ns) => format.format(new Date(ns / 1e6));
}
