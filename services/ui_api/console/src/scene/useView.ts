import { useCallback, useState } from "react";
import type { ViewId } from "./views";

/** Which view was chosen, how often one was, and whether a hand has turned it since. */
export function useView() {
  const [view, setView] = useState<{ id: ViewId; asked: number; isTurned: boolean }>({
    id: "surgeon",
    asked: 0,
    isTurned: false,
  });
  const choose = useCallback(
    (id: ViewId) => setView((old) => ({ id, asked: old.asked + 1, isTurned: false })),
    [],
  );
  const onTurned = useCallback(() => setView((old) => (old.isTurned ? old : { ...old, isTurned: true })), []);
  return { ...view, choose, onTurned };
}
