import { spoken } from "../languages/gateway";

/** The request that does it, which programs read: a person has a button. */
const REQUEST = /;? ?\(?(see )?(?:GET|POST|PUT|PATCH|DELETE) \/[\w/{}-]+\)?/g;
const HAN = /\p{Script=Han}[)）]?$/u;

/** A phrase of the gateway's as a sentence in the page's language: it begins with a capital and ends with a full stop. */
export function sentence(phrase: string): string {
  const said = spoken(phrase).replace(REQUEST, "");
  if (said === "") return "";
  const begun = said.charAt(0).toUpperCase() + said.slice(1);
  if (/[.!?。]$/.test(begun)) return begun;
  return begun + (HAN.test(begun) ? "。" : ".");
}
