// Pictures as grey values, decoded by the browser.
import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { onConnection } from "../api/connections";
import type { LiveFrame } from "../api/live";
import { greyValues } from "./decoder";
import { NewestFirst } from "./newestFirst";

export type PictureView = "raw" | "corrected";

export interface Pixels {
  /** Hash of the image. */
  readonly image: string;
  readonly view: PictureView;
  readonly width: number;
  readonly height: number;
  readonly values: Uint8Array | Uint16Array;
  /** How many grey values there can be. */
  readonly levels: number;
}

export interface Wanted {
  readonly image: string;
  readonly view: PictureView;
  /** Show the columns in reverse, so that a corrected picture lies as the C-arm shows it. */
  readonly isReversed: boolean;
}

const BYTE_VALUES = 256;
const KEPT_MS = 120_000;
/**
 * After a live picture the page rests for as long as that took, so that a finger on the stop does not wait behind
 * pictures where the processor draws them. Chosen: at 10 images/s none is passed over for it.
 */
const LONGEST_REST_MS = 60;

/** A stored picture; while the wanted one comes, the one before. */
export function usePixels(wanted: Wanted | null) {
  return useQuery({
    queryKey: ["pixels", wanted?.image, wanted?.view, wanted?.isReversed],
    queryFn: async ({ signal }) => {
      if (wanted === null) throw new Error("no picture is wanted");
      const blob = await fetchedPicture(wanted, signal);
      return await pixelsOf(blob, wanted.image, wanted.view, wanted.isReversed);
    },
    enabled: wanted !== null,
    staleTime: Number.POSITIVE_INFINITY,
    gcTime: KEPT_MS,
    placeholderData: keepPreviousData,
  });
}

async function fetchedPicture(wanted: Wanted, signal: AbortSignal): Promise<Blob> {
  const address = `/api/v1/images/${wanted.image}.png?view=${wanted.view}`;
  const response = await onConnection("usual", (within) => fetch(address, { signal: within }), signal);
  if (!response.ok) throw new Error(`status ${response.status}`);
  return await response.blob();
}

/** The newest picture of running fluoroscopy; frames that come while one is decoded are passed over. */
export function useLivePixels(live: LiveFrame | null): Pixels | null {
  const [pixels, setPixels] = useState<Pixels | null>(null);
  const [line] = useState(
    () =>
      new NewestFirst<{ readonly blob: Blob; readonly image: string }>(async ({ blob, image }) => {
        const began_ms = performance.now();
        setPixels(await pixelsOf(blob, image, "raw", false));
        await presented();
        await forMs(Math.min(performance.now() - began_ms, LONGEST_REST_MS));
      }),
  );
  const blob = live?.picture ?? null;
  const image = live?.pictureOf ?? null;
  useEffect(() => {
    if (blob !== null && image !== null) return line.take({ blob, image });
    line.forget();
    setPixels(null);
  }, [blob, image, line]);
  // One that was under way when the pictures ended is none of those that are wanted.
  return blob === null ? null : pixels;
}

/** The frame with what was set is drawn when the one after it begins. */
function presented(): Promise<void> {
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())));
}

function forMs(ms: number): Promise<void> {
  return new Promise((done) => setTimeout(done, ms));
}

async function pixelsOf(blob: Blob, image: string, view: PictureView, isReversed: boolean): Promise<Pixels> {
  return { image, view, ...(await greyValues(blob, isReversed)), levels: BYTE_VALUES };
}
