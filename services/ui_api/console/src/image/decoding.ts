// What the page and its decoder tell each other.

/** A picture to decode. */
export interface Asked {
  readonly number: number;
  readonly blob: Blob;
  /** Give the columns in reverse. */
  readonly isReversed: boolean;
}

export interface Decoded {
  readonly width: number;
  readonly height: number;
  /** Rows of the picture, one byte a pixel. */
  readonly values: Uint8Array<ArrayBuffer>;
}

/** The decoder's answer: `decoded` is null for what is no picture. */
export interface Answer {
  readonly number: number;
  readonly decoded: Decoded | null;
  readonly why: string;
}

/** Of opaque grey pixels as a canvas has them in memory: one byte of each. */
export function greysOf(rgba: Uint8ClampedArray): Uint8Array<ArrayBuffer> {
  const pixels = new Uint32Array(rgba.buffer, rgba.byteOffset, rgba.length / 4);
  const values = new Uint8Array(pixels.length);
  for (let i = 0; i < pixels.length; i++) values[i] = pixels[i] as number; // an element takes the lowest byte
  return values;
}
