import { useEffect, useRef } from "react";
import { type Grey, lookUpTable, shownPixels } from "./grey";
import type { Pixels } from "./pixels";
import type { Matrix } from "./view";

interface Props {
  readonly pixels: Pixels;
  readonly grey: Grey;
  readonly matrix: Matrix;
}

/** The picture in its own pixels; the browser's compositor moves it, so that panning draws nothing anew. */
export default function PictureCanvas({ pixels, grey, matrix }: Props) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const context = canvas.current?.getContext("2d", { alpha: false });
    if (!context) return;
    const frame = requestAnimationFrame(() => paint(context, pixels, grey));
    return () => cancelAnimationFrame(frame);
  }, [pixels, grey]);
  return (
    <canvas
      ref={canvas}
      className="picture"
      width={pixels.width}
      height={pixels.height}
      style={{ transform: `matrix(${matrix.join(",")})` }}
    />
  );
}

function paint(context: CanvasRenderingContext2D, pixels: Pixels, grey: Grey): void {
  const shown = new ImageData(pixels.width, pixels.height);
  shownPixels(pixels.values, lookUpTable(grey, pixels.levels), new Uint32Array(shown.data.buffer));
  context.putImageData(shown, 0, 0);
}
