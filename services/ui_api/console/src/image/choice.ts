// Which picture is shown: always the newest, whichever way it came first. Pure.
import type { Wanted } from "./pixels";

interface LiveSide {
  readonly image: string;
  readonly pictureOf: string | null;
  readonly sequence: number;
}

interface StoredSide {
  readonly id: string;
  readonly header: { readonly sequence: number } | null;
}

interface LocalisedSide {
  readonly image: { readonly sha256: string; readonly mirrored: boolean | null };
  readonly camera: object | null;
}

export interface Choice {
  /** The live picture is newer than all that the record has. */
  readonly isAhead: boolean;
  /** The live picture is that of the newest image on record. */
  readonly isSame: boolean;
}

export function choiceOf(live: LiveSide | null, newest: StoredSide | null): Choice {
  if (live === null || live.pictureOf === null) return { isAhead: false, isSame: false };
  if (newest === null) return { isAhead: true, isSame: false };
  return {
    isAhead: live.sequence > (newest.header?.sequence ?? -1),
    isSame: live.pictureOf === newest.id,
  };
}

/** The stored picture to fetch for the newest image on record. Only one that was measured can be corrected. */
export function wantedOf(
  newest: StoredSide | null,
  localised: LocalisedSide | null,
  wantsCorrected: boolean,
): Wanted | null {
  if (newest === null) return null;
  const isMeasured = localised !== null && localised.image.sha256 === newest.id && localised.camera !== null;
  if (!wantsCorrected || !isMeasured) return { image: newest.id, view: "raw", isReversed: false };
  return { image: newest.id, view: "corrected", isReversed: localised.image.mirrored === true };
}

/** Of a live and a stored picture that are both there, which is shown. */
export function isLiveShown(choice: Choice, newest: string | null, stored: string | null): boolean {
  return choice.isAhead || (choice.isSame && stored !== newest);
}
