// How old something is, in words that fit into a glance: pure but for the clock of the page's own uptime.
import { useEffect, useRef, useState } from "react";

const MINUTE_S = 60;
const HOUR_S = 3600;

/** `7 s`, `3 min 05 s`, `2 h 10 min`; units are the same in every language of the page. */
export function ageText(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds));
  if (whole < MINUTE_S) return `${whole} s`;
  if (whole < HOUR_S) return `${Math.floor(whole / MINUTE_S)} min ${twoDigits(whole % MINUTE_S)} s`;
  return `${Math.floor(whole / HOUR_S)} h ${twoDigits(Math.floor((whole % HOUR_S) / MINUTE_S))} min`;
}

function twoDigits(n: number): string {
  return String(n).padStart(2, "0");
}

/**
 * The age now of something whose age the gateway stated: it grows with the page's monotonic clock, so that a wrong
 * clock of this computer does not matter. `of` names what it is the age of.
 */
export function useAge(of: string | null, statedS: number | null): number | null {
  const [now, setNow] = useState(() => performance.now());
  const born = useRef<{ readonly of: string; readonly atMs: number } | null>(null);
  useEffect(() => {
    const timer = setInterval(() => setNow(performance.now()), 1000);
    return () => clearInterval(timer);
  }, []);
  if (of === null || statedS === null) return null;
  // The first statement counts: later ones are the same within the network's delays.
  if (born.current?.of !== of) born.current = { of, atMs: performance.now() - 1000 * statedS };
  return Math.max(0, (Math.max(now, performance.now()) - born.current.atMs) / 1000);
}
