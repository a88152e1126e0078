// Paths of SVG: pure.
import type { Point } from "./view";

interface Ellipse {
  readonly centre_px: Point;
  readonly semi_major_px: number;
  readonly semi_minor_px: number;
  readonly major_axis_deg: number;
}

/** A closed path of two arcs. */
export function ellipsePath(ellipse: Ellipse): string {
  const { semi_major_px: major, semi_minor_px: minor, major_axis_deg: deg } = ellipse;
  const [x, y] = ellipse.centre_px;
  const dx = major * Math.cos((deg * Math.PI) / 180);
  const dy = major * Math.sin((deg * Math.PI) / 180);
  const arc = `A ${major} ${minor} ${deg} 0 1`;
  return `M ${x - dx} ${y - dy} ${arc} ${x + dx} ${y + dy} ${arc} ${x - dx} ${y - dy} Z`;
}

export function linePath(line: readonly Point[]): string {
  return line.map(([x, y], i) => `${i === 0 ? "M" : "L"} ${x} ${y}`).join(" ");
}

/** How many pixels lines extend about a place, for a magnifier to choose its power. */
export function extentAbout(centre: Point, lines: readonly (readonly Point[])[]): number {
  const away = lines.flat().map(([x, y]) => Math.max(Math.abs(x - centre[0]), Math.abs(y - centre[1])));
  return Math.max(1, ...away);
}

// Chosen: the limit of a good fit is about a quarter of a pixel; a pixel is far beyond all that noise explains.
const GOOD_PX = 0.25;
const BAD_PX = 1;

/** Colour of a ball by its residual: green up to a quarter of a pixel, then over yellow to red at one pixel. */
export function residualColour(residualPx: number): string {
  const share = Math.min(Math.max((residualPx - GOOD_PX) / (BAD_PX - GOOD_PX), 0), 1);
  return `hsl(${Math.round(130 * (1 - share))} 90% 60%)`;
}
