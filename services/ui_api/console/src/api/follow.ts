// The log as a stream: whatever it says makes what was read of cases out of date.
import { type QueryClient, useQueryClient } from "@tanstack/react-query";
import { useEffect } from "react";
import { CASE, drawingQuery } from "./queries";
import { renewed } from "./renewal";
import { readEvents } from "./sse";

const AGAIN_AFTER_MS = 500;
// Several events come of one act; what they change is read once.
const TOGETHER_MS = 40;
const ACCOUNTS = "account_changed";
const LOCALISED = "localisation_received";

/** Follow the log for as long as the page shows. */
export function useFollowing(enabled: boolean): void {
  const client = useQueryClient();
  useEffect(() => {
    if (!enabled) return;
    const leaving = new AbortController();
    void follow(client, leaving.signal);
    return () => leaving.abort();
  }, [client, enabled]);
}

async function follow(client: QueryClient, signal: AbortSignal): Promise<void> {
  let lastId = "";
  const refresh = gathered(() => void client.invalidateQueries({ queryKey: [CASE] }));
  while (!signal.aborted) {
    try {
      await readEvents("/api/v1/events", lastId, signal, (event) => {
        if (event !== null) lastId = event.id || lastId;
        if (event?.kind === LOCALISED) fetchDrawing(client, event.data);
        if (event?.kind === ACCOUNTS) void client.invalidateQueries({ queryKey: ["users"] });
        refresh();
      });
    } catch {
      // Access may have ended, or the gateway is gone: both are said elsewhere.
    }
    if (signal.aborted) return;
    await renewed().catch(() => false);
    await new Promise((resolve) => setTimeout(resolve, AGAIN_AFTER_MS));
  }
}

/** The drawing of a localisation, while the localisation itself is read: the surgeon waits for both. */
function fetchDrawing(client: QueryClient, event: string): void {
  const { case_id, data } = JSON.parse(event) as { case_id: string; data: { number: number } };
  void client.prefetchQuery({ ...drawingQuery(case_id, data.number), retry: false });
}

/** Call once for several calls that come close together. */
export function gathered(act: () => void, withinMs = TOGETHER_MS): () => void {
  let waiting = false;
  return () => {
    if (waiting) return;
    waiting = true;
    setTimeout(() => {
      waiting = false;
      act();
    }, withinMs);
  };
}
