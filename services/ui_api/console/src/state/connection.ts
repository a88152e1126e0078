// Whether what the page shows is live: a pure function of when the gateway last answered.

export type Connection = "live" | "lost";

/** Chosen: the gateway is asked four times a second; that it is gone must be said within 2 s. */
export const LOST_AFTER_MS = 1_100;

export interface Answers {
  /** When the newest answer came, by the page's monotonic clock; null before the first. */
  readonly newestAtMs: number | null;
  readonly startedAtMs: number;
}

export function connectionAt(answers: Answers, nowMs: number): Connection {
  return nowMs - (answers.newestAtMs ?? answers.startedAtMs) <= LOST_AFTER_MS ? "live" : "lost";
}

/** Age of a value now: what it was when it came, and the time since. */
export function ageNow(ageS: number | null, gotAtMs: number, nowMs: number): number | null {
  return ageS === null ? null : ageS + Math.max(0, nowMs - gotAtMs) / 1_000;
}
