import { useEffect, useRef } from "react";
import type { Grey } from "./grey";
import { paintedPicture } from "./painted";
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
    const frame = requestAnimationFrame(() => context.drawImage(paintedPicture(pixels, grey), 0, 0));
    return () => cancelAnimationFrame(frame);
  }, [pixels, grey]);
  return (
    <canvas
      ref={canvas}
      className="picture"
      data-image={pixels.image}
      width={pixels.width}
      height={pixels.height}
      style={{ transform: `matrix(${matrix.join(",")})` }}
    />
  );
}
