// Sentences of the gateway in the page's language, by their English text: `gateway.*.json`. Pure but for the language.
import i18next from "i18next";

/** Of a language: English sentence, with names in braces for the values that it quotes, to its translation. */
export type Sentences = Readonly<Record<string, string>>;

interface Pattern {
  readonly form: RegExp;
  readonly names: readonly string[];
  readonly translation: string;
}

const NAME = /\{(\w+)\}/g;
const patterns = new WeakMap<Sentences, readonly Pattern[]>();

const byLanguage = new Map<string, Sentences>();

export function learn(language: string, sentences: Sentences): void {
  byLanguage.set(language, sentences);
}

/** In the language that the page speaks; in English where it is not known. */
export function spoken(phrase: string): string {
  const known = byLanguage.get(i18next.language);
  return known === undefined ? phrase : translated(phrase, known);
}

export function translated(phrase: string, known: Sentences): string {
  const whole = wholeOf(phrase, known);
  if (whole !== undefined) return whole;
  for (const { form, names, translation } of patternsOf(known)) {
    const values = form.exec(phrase)?.slice(1);
    if (values !== undefined)
      return translation.replace(NAME, (_, name: string) => {
        const value = values[names.indexOf(name)] ?? "";
        return wholeOf(value, known) ?? value;
      });
  }
  return phrase;
}

function wholeOf(phrase: string, known: Sentences): string | undefined {
  return Object.hasOwn(known, phrase) ? known[phrase] : undefined;
}

function patternsOf(known: Sentences): readonly Pattern[] {
  const made = patterns.get(known) ?? Object.entries(known).flatMap(patternOf);
  patterns.set(known, made);
  return made;
}

function patternOf([english, translation]: readonly [string, string]): Pattern[] {
  const names = [...english.matchAll(NAME)].map((match) => match[1] ?? "");
  if (names.length === 0) return [];
  const parts = english.split(/\{\w+\}/).map((part) => part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&"));
  return [{ form: new RegExp(`^${parts.join("(.+?)")}$`, "s"), names, translation }];
}
