import { useSyncExternalStore } from "react";
import { type LiveFrame, liveFeed } from "./live";

/** The newest live frame; null while there is none, and while the connection is lost. */
export function useLive(): LiveFrame | null {
  return useSyncExternalStore(liveFeed.subscribe, liveFeed.frame);
}
