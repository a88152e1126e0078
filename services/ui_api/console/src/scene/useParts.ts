import { useQuery } from "@tanstack/react-query";
import { content, gateway } from "../api/client";
import type { CaseView } from "../api/types";
import type { Parts } from "./parts";

const KINDS = ["hexapod", "guide", "nail", "ring"] as const;

/** The part files that the case uses; they change only with their hashes. */
export function useParts(caseView: CaseView): Parts | null {
  const hashes = KINDS.map((kind) => caseView[kind].sha256);
  const read = useQuery({
    queryKey: ["parts", caseView.id, ...hashes],
    queryFn: async (): Promise<Parts> => {
      const files = await Promise.all(KINDS.map((kind) => readPart(caseView.id, kind)));
      return Object.fromEntries(KINDS.map((kind, index) => [kind, files[index]])) as unknown as Parts;
    },
    staleTime: Number.POSITIVE_INFINITY,
  });
  return read.data ?? null;
}

function readPart(case_id: string, kind: (typeof KINDS)[number]): Promise<unknown> {
  return content(
    gateway.GET("/api/v1/cases/{case_id}/parts/{kind}", { params: { path: { case_id, kind } } }),
  );
}
