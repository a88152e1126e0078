/** A phrase of the gateway's as a sentence: it begins with a capital and ends with a full stop. */
export function sentence(phrase: string): string {
  if (phrase === "") return "";
  const begun = phrase.charAt(0).toUpperCase() + phrase.slice(1);
  return /[.!?。]$/.test(begun) ? begun : `${begun}.`;
}
