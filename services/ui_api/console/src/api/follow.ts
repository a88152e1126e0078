// The log as a stream: whatever it says makes what was read of cases out of date.
import { type QueryClient, useQueryClient } from "@tanstack/react-query";
import { useEffect } from "react";
import { CASE, readDrawn } from "./queries";
import { renewed } from "./renewal";
import { readEvents, type ServerEvent } from "./sse";
import { areTabsShared, locks } from "./tabs";

const AGAIN_AFTER_MS = 500;
// Several events come of one act; what they change is read once.
const TOGETHER_MS = 40;
const ACCOUNTS = "account_changed";
const LOCALISED = "localisation_received";
const TABS = "distalock events";

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

/**
 * One tab of the browser reads the stream, and the others hear of it: each stream takes one of the connections that the
 * tabs share. It is one that is seen, because a browser lets the others sleep.
 */
async function follow(client: QueryClient, signal: AbortSignal): Promise<void> {
  let lastId = "";
  const refresh = gathered(() => void client.invalidateQueries({ queryKey: [CASE] }));
  const take = (event: ServerEvent | null) => {
    if (event !== null) lastId = event.id || lastId;
    if (event?.kind === LOCALISED) readLocalised(client, event.data);
    if (event?.kind === ACCOUNTS) void client.invalidateQueries({ queryKey: ["users"] });
    refresh();
  };
  const others = areTabsShared ? new BroadcastChannel(TABS) : null;
  if (others) others.onmessage = ({ data }: MessageEvent<ServerEvent | null>) => take(data);
  const takeForAll = (event: ServerEvent | null) => {
    take(event);
    others?.postMessage(event);
  };
  while (!signal.aborted) {
    await becomes("visible", signal);
    const hidden = new AbortController();
    void becomes("hidden", signal).then(() => hidden.abort());
    const read = () => readOn(() => lastId, takeForAll, hidden.signal);
    await locks.request(TABS, { signal: hidden.signal }, read).catch(() => undefined);
  }
  others?.close();
}

/** Read the stream again and again until `signal`. */
async function readOn(
  lastId: () => string,
  take: (event: ServerEvent | null) => void,
  signal: AbortSignal,
): Promise<void> {
  while (!signal.aborted) {
    await readEvents("/api/v1/events", lastId(), signal, take).catch(() => undefined);
    // Access may have ended, or the gateway is gone: both are said elsewhere.
    if (signal.aborted) return;
    await renewed().catch(() => false);
    await new Promise((resolve) => setTimeout(resolve, AGAIN_AFTER_MS));
  }
}

/** When this tab is seen, or is not any more; also when the page is left. */
function becomes(state: DocumentVisibilityState, leaving: AbortSignal): Promise<void> {
  return new Promise((done) => {
    const heard = new AbortController();
    const look = () => {
      if (document.visibilityState !== state && !leaving.aborted) return;
      heard.abort();
      done();
    };
    document.addEventListener("visibilitychange", look, { signal: heard.signal });
    leaving.addEventListener("abort", look, { signal: heard.signal });
    look();
  });
}

/** What the surgeon waits for is read by itself and at once, before all else that has changed. */
function readLocalised(client: QueryClient, event: string): void {
  const { case_id, data } = JSON.parse(event) as { case_id: string; data: { number: number } };
  readDrawn(client, case_id, data.number).catch(() => undefined); // it is read with all else
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
