// The picture that the newest one is compared with.
import type { ImageView } from "../api/types";
import type { Shown } from "./Pane";
import { usePixels } from "./pixels";
import { useDrawing, useLocalisation, useNewestImages } from "./results";

export interface Before {
  readonly choice: readonly ImageView[];
  readonly image: ImageView | null;
  readonly shown: Shown | null;
}

/** The chosen image, or the newest other one; `enabled` while it is to be seen. */
export function useBefore(
  caseId: string,
  shownImage: string,
  chosen: string | null,
  enabled: boolean,
  labelOf: (image: ImageView) => string,
): Before {
  const images = useNewestImages(caseId, enabled).data ?? [];
  const choice = images.filter((image) => image.id !== shownImage);
  const image = choice.find((one) => one.id === chosen) ?? choice[0] ?? null;
  const localisation = useLocalisation(caseId, enabled ? (image?.localisation ?? null) : null);
  const drawing = useDrawing(caseId, localisation);
  const wanted = image && enabled ? ({ image: image.id, view: "raw", isReversed: false } as const) : null;
  const pixels = usePixels(wanted).data ?? null;
  const isThere = enabled && image !== null && pixels !== null && pixels.image === image.id;
  return {
    choice,
    image,
    shown: isThere ? { pixels, drawing, label: labelOf(image) } : null,
  };
}
