// Window and level: which grey values of the picture are shown between black and white. Pure.

export interface Grey {
  /** Middle and width of the shown range, as shares of the picture's own: 0 is its darkest value, 1 its brightest. */
  readonly level: number;
  readonly window: number;
  readonly isInverted: boolean;
}

export const AS_IT_CAME: Grey = { level: 0.5, window: 1, isInverted: false };
const LEAST_WINDOW = 0.02;
const MOST_WINDOW = 3;
// Chosen: a drag over the whole place changes either by the whole range.
const PER_PLACE = 1;

/** As in other viewers: right makes the window wider, down makes the picture brighter. */
export function dragged(grey: Grey, byShare: readonly [x: number, y: number]): Grey {
  const window = Math.min(Math.max(grey.window + PER_PLACE * byShare[0], LEAST_WINDOW), MOST_WINDOW);
  const level = Math.min(Math.max(grey.level - PER_PLACE * byShare[1], 0), 1);
  return { ...grey, level, window };
}

/** Opaque RGBA pixels, one for each grey value of the picture, as a canvas has them in memory. */
export function lookUpTable(grey: Grey, values: number): Uint32Array {
  const table = new Uint32Array(values);
  const bytes = new Uint8ClampedArray(table.buffer);
  const darkest = grey.level - grey.window / 2;
  for (let i = 0; i < values; i++) {
    const share = (i / (values - 1) - darkest) / grey.window;
    const shown = 255 * (grey.isInverted ? 1 - share : share);
    bytes.fill(shown, 4 * i, 4 * i + 3);
    bytes[4 * i + 3] = 255;
  }
  return table;
}

/** Look every value up. */
export function shownPixels(values: Uint8Array | Uint16Array, table: Uint32Array, into: Uint32Array): void {
  for (let i = 0; i < values.length; i++) into[i] = table[values[i] as number] as number;
}
