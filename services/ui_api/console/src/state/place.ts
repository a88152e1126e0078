// Where the page is: a part of the address after `#`, so that a reload comes back to it. It names no patient.
import { useSyncExternalStore } from "react";

export type Place =
  | { readonly name: "room" | "wall" | "cases" | "users" | "service" }
  | { readonly name: "case"; readonly id: string };

const PLAIN = ["wall", "cases", "users", "service"] as const;
const CASE_ID = /^[A-Za-z0-9-]{1,64}$/;

export function placeOf(hash: string): Place {
  const [first, second] = hash.replace(/^#\/?/, "").split("/");
  if (first === "cases" && second !== undefined && CASE_ID.test(second)) return { name: "case", id: second };
  const plain = PLAIN.find((name) => name === first);
  return { name: plain ?? "room" };
}

export function casePath(id: string): string {
  return `#/cases/${id}`;
}

function subscribe(listener: () => void): () => void {
  window.addEventListener("hashchange", listener);
  return () => window.removeEventListener("hashchange", listener);
}

export function usePlace(): Place {
  return placeOf(useSyncExternalStore(subscribe, () => globalThis.location.hash));
}
