// The planned motion, played: share of the way, 0 to 1.
import { useEffect, useState } from "react";
import { hasEnded, shareAt } from "./motion";

// Chosen: 25 pictures a second look like a motion, and leave a processor that draws by itself room for the rest.
const EVERY_MS = 40;

export interface Ghost {
  readonly share: number | null;
  readonly isPlaying: boolean;
  readonly play: () => void;
  readonly pause: () => void;
  readonly hide: () => void;
  readonly show: (share: number) => void;
}

type State = { readonly kind: "hidden" } | { readonly kind: "playing" | "held"; readonly share: number };

/** `starts`: whether it plays by itself, as before an approval. A motion of another plan begins anew. */
export function useGhost(plan: string | null, starts: boolean, played_s: number): Ghost {
  const [state, setState] = useState<State>({ kind: "hidden" });
  useEffect(() => {
    // Whoever wants no motion on the page sees where the planned one ends.
    const still = globalThis.matchMedia?.("(prefers-reduced-motion: reduce)").matches ?? false;
    if (plan === null || !starts) setState({ kind: "hidden" });
    else setState(still ? { kind: "held", share: 1 } : { kind: "playing", share: 0 });
  }, [plan, starts]);
  const isPlaying = state.kind === "playing";
  useEffect(() => {
    if (!isPlaying) return;
    const begun_ms = performance.now();
    let request = 0;
    let shown_ms = 0;
    const next = (at_ms: number) => {
      request = requestAnimationFrame(next);
      if (at_ms - shown_ms < EVERY_MS - 4) return;
      shown_ms = at_ms;
      const time_s = (at_ms - begun_ms) / 1000;
      if (hasEnded(time_s, played_s)) setState({ kind: "held", share: 1 });
      else setState({ kind: "playing", share: shareAt(time_s, played_s) });
    };
    request = requestAnimationFrame(next);
    return () => cancelAnimationFrame(request);
  }, [isPlaying, played_s]);
  return {
    share: plan === null || state.kind === "hidden" ? null : state.share,
    isPlaying,
    play: () => setState({ kind: "playing", share: 0 }),
    pause: () => setState((old) => (old.kind === "playing" ? { kind: "held", share: old.share } : old)),
    hide: () => setState({ kind: "hidden" }),
    show: (share) => setState({ kind: "held", share }),
  };
}
