import { useAlignment } from "../api/queries";
import type { LocalisationView } from "../api/types";
import { useLive } from "../api/useLive";
import { type Advice, newestAdvice, ofAlignment } from "./advice";

/** The newest advice on turning the C-arm, of fluoroscopy or of a single image; null before there is any. */
export function useAdvice(caseId: string, localisation: LocalisationView | null): Advice | null {
  const live = useLive();
  const guidance = live?.case_id === caseId ? live.guidance : null;
  const alignment = useAlignment(caseId, localisation !== null).data ?? null;
  const single = alignment && ofAlignment(alignment, localisation?.reasons ?? []);
  return newestAdvice(guidance, single);
}
