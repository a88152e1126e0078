// Pictures as grey values, decoded by the browser.
import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import type { LiveFrame } from "../api/live";

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

/** A stored picture; while the wanted one comes, the one before. */
export function usePixels(wanted: Wanted | null) {
  return useQuery({
    queryKey: ["pixels", wanted?.image, wanted?.view, wanted?.isReversed],
    queryFn: async ({ signal }) => {
      if (wanted === null) throw new Error("no picture is wanted");
      const blob = await fetchedPicture(wanted, signal);
      return await greyValues(blob, wanted.image, wanted.view, wanted.isReversed);
    },
    enabled: wanted !== null,
    staleTime: Number.POSITIVE_INFINITY,
    gcTime: KEPT_MS,
    placeholderData: keepPreviousData,
  });
}

async function fetchedPicture(wanted: Wanted, signal: AbortSignal): Promise<Blob> {
  const response = await fetch(`/api/v1/images/${wanted.image}.png?view=${wanted.view}`, { signal });
  if (!response.ok) throw new Error(`status ${response.status}`);
  return await response.blob();
}

/** The newest picture of running fluoroscopy; frames that come while one is decoded are passed over. */
export function useLivePixels(live: LiveFrame | null): Pixels | null {
  const [pixels, setPixels] = useState<Pixels | null>(null);
  const blob = live?.picture ?? null;
  const image = live?.pictureOf ?? null;
  useEffect(() => {
    if (blob === null || image === null) {
      setPixels(null);
      return;
    }
    let isWanted = true;
    greyValues(blob, image, "raw", false).then(
      (decoded) => isWanted && setPixels(decoded),
      () => undefined, // a broken frame is followed by a whole one
    );
    return () => {
      isWanted = false;
    };
  }, [blob, image]);
  return pixels;
}

async function greyValues(
  blob: Blob,
  image: string,
  view: PictureView,
  isReversed: boolean,
): Promise<Pixels> {
  const bitmap = await createImageBitmap(blob);
  const { width, height } = bitmap;
  const context = scratchOf(width, height);
  context.setTransform(isReversed ? -1 : 1, 0, 0, 1, isReversed ? width : 0, 0);
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const rgba = new Uint32Array(context.getImageData(0, 0, width, height).data.buffer);
  const values = new Uint8Array(rgba.length);
  for (let i = 0; i < rgba.length; i++) values[i] = (rgba[i] as number) & (BYTE_VALUES - 1);
  return { image, view, width, height, values, levels: BYTE_VALUES };
}

let scratch: CanvasRenderingContext2D | null = null;

/** A canvas from which pixels are read again and again. */
function scratchOf(width: number, height: number): CanvasRenderingContext2D {
  if (scratch === null || scratch.canvas.width !== width || scratch.canvas.height !== height) {
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    scratch = canvas.getContext("2d", { willReadFrequently: true });
  }
  if (scratch === null) throw new Error("this browser draws nothing on a canvas");
  return scratch;
}
