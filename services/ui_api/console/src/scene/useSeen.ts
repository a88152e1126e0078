import { useQuery } from "@tanstack/react-query";
import { content, gateway } from "../api/client";
import { CASE } from "../api/queries";
import type { CaseView, LocalisationView } from "../api/types";

const HOW_MANY = 10;

/** The newest localisation that shows where the nail is: the newest of all, or one before it of the same set-up. */
export function useSeen(caseView: CaseView, newest: LocalisationView | null): LocalisationView | null {
  const needsEarlier = newest !== null && !showsNail(newest);
  const earlier = useQuery({
    queryKey: [CASE, caseView.id, "localisations with nail", newest?.number ?? null],
    queryFn: async () => {
      const page = await content(
        gateway.GET("/api/v1/cases/{case_id}/localisations", {
          params: { path: { case_id: caseView.id }, query: { sort: "newest", limit: HOW_MANY } },
        }),
      );
      return (
        page.items.find((one) => showsNail(one) && one.provenance.case_revision === caseView.revision) ?? null
      );
    },
    enabled: needsEarlier,
  });
  return needsEarlier ? (earlier.data ?? null) : newest;
}

function showsNail(localisation: LocalisationView): boolean {
  return localisation.guide_from_nail !== null && localisation.provenance.robot_pose !== null;
}
