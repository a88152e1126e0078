import { useTranslation } from "react-i18next";
import { lengthsOf, type Scales } from "./ruler";
import { type Matrix, middle, type Point, toScreen } from "./view";

export type RulerLine = readonly [Point, Point];

interface Props {
  readonly line: RulerLine;
  readonly matrix: Matrix;
  readonly scales: Scales | null;
  readonly isCorrected: boolean;
}

/** A line with its length at the hole and at the detector. */
export default function Ruler({ line, matrix, scales, isCorrected }: Props) {
  const { t } = useTranslation();
  const [from, to] = [toScreen(matrix, line[0]), toScreen(matrix, line[1])];
  const [x, y] = middle(from, to);
  const lengths = scales === null ? null : lengthsOf(line, scales);
  // A raw picture is distorted by some per cent, a nominal pixel is what somebody typed in.
  const about = isCorrected && scales?.isNominal === false ? "" : "≈ ";
  return (
    <>
      <svg className="ruler" aria-hidden="true">
        <line x1={from[0]} y1={from[1]} x2={to[0]} y2={to[1]} />
        {[from, to].map(([cx, cy], i) => (
          // biome-ignore lint/suspicious/noArrayIndexKey: both ends
          <circle key={i} cx={cx} cy={cy} r={7} />
        ))}
      </svg>
      <output className="ruler-text" style={{ transform: `translate(${x}px, ${y}px)` }}>
        {lengths === null && t("image.ruler.no_scale")}
        {lengths?.holeMm != null && (
          <strong>
            {about}
            {lengths.holeMm.toFixed(1)} mm {t("image.ruler.at_hole")}
          </strong>
        )}
        {lengths && (
          <span>
            {about}
            {lengths.detectorMm.toFixed(1)} mm{" "}
            {t(scales?.isNominal ? "image.ruler.at_detector_nominal" : "image.ruler.at_detector")}
          </span>
        )}
      </output>
    </>
  );
}
