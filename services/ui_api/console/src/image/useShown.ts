import { useEffect, useState } from "react";
import type { LiveFrame } from "../api/live";
import type { CaseView, ImageView, LocalisationView } from "../api/types";
import { useLive } from "../api/useLive";
import { choiceOf, isLiveShown, wantedOf } from "./choice";
import { type Pixels, useLivePixels, usePixels } from "./pixels";

// Chosen: frames of running fluoroscopy follow one another faster; their stored pictures are not fetched.
const SETTLED_AFTER_MS = 700;

export interface ShownPicture {
  readonly pixels: Pixels | null;
  /** The picture is newer than all that the record has. */
  readonly isAhead: boolean;
  readonly live: LiveFrame | null;
}

export function useShown(
  caseView: CaseView,
  newestImage: ImageView | null,
  localisation: LocalisationView | null,
  wantsCorrected: boolean,
): ShownPicture {
  const feed = useLive();
  const live = feed?.case_id === caseView.id ? feed : null;
  const choice = choiceOf(live, newestImage);
  const livePixels = useLivePixels(choice.isAhead || choice.isSame ? live : null);
  const isSettled = useSettled(newestImage?.id ?? null, choice.isSame ? SETTLED_AFTER_MS : 0);
  const wanted = wantedOf(newestImage, localisation, wantsCorrected);
  const stored = usePixels(isSettled ? wanted : null).data ?? null;
  const isLive = isLiveShown(choice, newestImage?.id ?? null, stored?.image ?? null);
  return { pixels: (isLive ? livePixels : null) ?? stored, isAhead: choice.isAhead, live };
}

/** Whether a value has been the same for so long. */
function useSettled(value: string | null, afterMs: number): boolean {
  const [settled, setSettled] = useState<string | null>(null);
  useEffect(() => {
    const timer = setTimeout(() => setSettled(value), afterMs);
    return () => clearTimeout(timer);
  }, [value, afterMs]);
  return afterMs === 0 || settled === value;
}
