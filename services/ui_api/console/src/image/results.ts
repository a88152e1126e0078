// What the panels of this folder read beside what they are given.
import { useQuery } from "@tanstack/react-query";
import { content, gateway, type Schemas } from "../api/client";
import { CASE, drawingQuery } from "../api/queries";
import type { LocalisationView } from "../api/types";

export type ImageDrawing = Schemas["ImageDrawing"];
export type Drawing = Schemas["Drawing"];
export type DrawnHole = Schemas["DrawnHole"];
export type DrawnBall = Schemas["DrawnBall"];
export type DrawnEllipse = Schemas["DrawnEllipse"];

const CHOICE = 12;

/** What was found as vectors; null until it is there, and for an image without a ring. It never changes. */
export function useDrawing(caseId: string, localisation: LocalisationView | null): ImageDrawing | null {
  const number = localisation?.number ?? 0;
  const query = useQuery({
    ...drawingQuery(caseId, number),
    enabled: localisation !== null && localisation.camera !== null,
  });
  const drawing = query.data ?? null;
  return drawing !== null && drawing.image_sha256 === localisation?.image.sha256 ? drawing : null;
}

/** One localisation by its number; null while it is not there. */
export function useLocalisation(caseId: string, number: number | null): LocalisationView | null {
  const query = useQuery({
    queryKey: [CASE, caseId, "localisation", number],
    queryFn: () =>
      content(
        gateway.GET("/api/v1/cases/{case_id}/localisations/{number}", {
          params: { path: { case_id: caseId, number: number ?? 0 } },
        }),
      ),
    enabled: number !== null,
  });
  return query.data ?? null;
}

/** The newest images of the case, the newest first. */
export function useNewestImages(caseId: string, enabled: boolean) {
  return useQuery({
    queryKey: [CASE, caseId, "newest images"],
    queryFn: async () => {
      const page = await content(
        gateway.GET("/api/v1/cases/{case_id}/images", {
          params: { path: { case_id: caseId }, query: { sort: "newest", limit: CHOICE } },
        }),
      );
      return page.items;
    },
    enabled,
  });
}
