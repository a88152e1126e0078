// Lengths in the picture: pure. One pixel covers less at the hole than at the detector, because rays diverge.
import { distance, type Point } from "./view";

export interface Scales {
  readonly detectorMmPerPx: number;
  /** Null while no hole was found in this image. */
  readonly holeMmPerPx: number | null;
  /** The detector's scale is stated by the image's header, not measured with the ring. */
  readonly isNominal: boolean;
}

export interface Lengths {
  readonly detectorMm: number;
  readonly holeMm: number | null;
}

export function lengthsOf(line: readonly [Point, Point], scales: Scales): Lengths {
  const px = distance(...line);
  return {
    detectorMm: px * scales.detectorMmPerPx,
    holeMm: scales.holeMmPerPx === null ? null : px * scales.holeMmPerPx,
  };
}

interface Measured {
  readonly mm_per_px_at_detector: number;
  readonly raw: { readonly holes: readonly { readonly localised: boolean; readonly mm_per_px: number }[] };
}

/** From what was measured in the image; else from its header; null when neither is there. */
export function scalesOf(measured: Measured | null, nominalPixelMm: number | null): Scales | null {
  if (measured !== null) {
    const holes = measured.raw.holes.filter((hole) => hole.localised).map((hole) => hole.mm_per_px);
    return {
      detectorMmPerPx: measured.mm_per_px_at_detector,
      holeMmPerPx: holes.length > 0 ? holes.reduce((sum, mm) => sum + mm, 0) / holes.length : null,
      isNominal: false,
    };
  }
  if (nominalPixelMm === null || nominalPixelMm <= 0) return null;
  return { detectorMmPerPx: nominalPixelMm, holeMmPerPx: null, isNominal: true };
}

/** Which end of the line is within reach of a finger; null when neither is. */
export function endNear(line: readonly [Point, Point], at: Point, reach: number): 0 | 1 | null {
  const [first, second] = [distance(line[0], at), distance(line[1], at)];
  if (Math.min(first, second) > reach) return null;
  return first <= second ? 0 : 1;
}
