// The picture as it is shown, painted once for all places that show it: the whole, and each hole's magnifier.
import { type Grey, lookUpTable, shownPixels } from "./grey";
import type { Pixels } from "./pixels";

interface Painted {
  readonly grey: Grey;
  readonly canvas: OffscreenCanvas;
}

const painted = new WeakMap<Pixels, Painted>();

let scratch: ImageData | null = null;

/** For what is painted, one after another: 4 MB for each would be collected again and again. */
function scratchOf({ width, height }: Pixels): ImageData {
  if (scratch?.width !== width || scratch.height !== height) scratch = new ImageData(width, height);
  return scratch;
}

/** Painted with this window and level; what was painted with another is painted over. */
export function paintedPicture(pixels: Pixels, grey: Grey): OffscreenCanvas {
  const before = painted.get(pixels);
  if (before?.grey === grey) return before.canvas;
  const canvas = before?.canvas ?? new OffscreenCanvas(pixels.width, pixels.height);
  const context = canvas.getContext("2d", { alpha: false });
  if (context !== null) {
    const shown = scratchOf(pixels);
    shownPixels(pixels.values, lookUpTable(grey, pixels.levels), new Uint32Array(shown.data.buffer));
    context.putImageData(shown, 0, 0);
  }
  painted.set(pixels, { grey, canvas });
  return canvas;
}
