// What the page and the thread that draws the scene tell each other.
import type { Parts } from "./parts";
import type { Sources } from "./sceneModel";
import type { Point } from "./transform";
import type { ViewId } from "./views";

/** Where the camera stands, and how much it sees. */
export interface CameraPlace {
  readonly position_mm: Point;
  readonly turn_xyzw: readonly [number, number, number, number];
  readonly opening_deg: number;
  readonly near_mm: number;
  readonly far_mm: number;
}

/** Size of the picture in CSS pixels, and how many pixels of the screen each of them has. */
export interface PictureSize {
  readonly width: number;
  readonly height: number;
  readonly pixelRatio: number;
}

/** All that the picture depends on, as plain values: they are copied from one thread to the other. */
export interface Drawn {
  readonly parts: Parts;
  readonly sources: Sources;
  readonly source_to_detector_mm: number;
  /** How far the ghost is on its way, 0 to 1; null without one. */
  readonly ghostShare: number | null;
  readonly isLive: boolean;
  readonly view: ViewId;
  readonly size: PictureSize;
  readonly camera: CameraPlace;
}

/** To the drawing thread: its canvas, once and first, then whatever has changed. */
export type Told = { readonly canvas: OffscreenCanvas } | { readonly changed: Partial<Drawn> };

/** From it: why there is no picture. */
export type NoPicture = "missing" | "lost";
