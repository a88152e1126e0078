// How the picture lies in its place: pure. Screen coordinates are CSS pixels of the place, image coordinates are those
// of the picture as it came, with pixel (0, 0) from 0 to 1.

export type Point = readonly [x: number, y: number];

export interface Size {
  readonly width: number;
  readonly height: number;
}

export interface View {
  /** 1 shows the whole picture. */
  readonly zoom: number;
  /** The image's place in the middle of the screen's. */
  readonly centre: Point;
  /** Clockwise on the screen, before mirroring. */
  readonly quarterTurns: number;
  /** Left and right exchanged on the screen, after turning. */
  readonly mirrored: boolean;
}

/** `screen = (a c e; b d f) image`, in the order of CSS and SVG. */
export type Matrix = readonly [a: number, b: number, c: number, d: number, e: number, f: number];

const MOST_ZOOM = 40;
const LEAST_ZOOM = 0.5;

export function wholePicture(image: Size, before?: View): View {
  return {
    zoom: 1,
    centre: [image.width / 2, image.height / 2],
    quarterTurns: before?.quarterTurns ?? 0,
    mirrored: before?.mirrored ?? false,
  };
}

/** CSS pixels per image pixel at zoom 1. */
export function fitScale(view: View, image: Size, place: Size): number {
  const isUpright = view.quarterTurns % 2 === 0;
  const width = isUpright ? image.width : image.height;
  const height = isUpright ? image.height : image.width;
  return Math.max(Math.min(place.width / width, place.height / height), 1e-6);
}

export function matrixOf(view: View, image: Size, place: Size): Matrix {
  const scale = view.zoom * fitScale(view, image, place);
  const [cos, sin] = turn(view.quarterTurns);
  const across = view.mirrored ? -1 : 1;
  const a = across * scale * cos;
  const b = scale * sin;
  const c = -across * scale * sin;
  const d = scale * cos;
  const [x, y] = view.centre;
  return [a, b, c, d, place.width / 2 - a * x - c * y, place.height / 2 - b * x - d * y];
}

export function toScreen([a, b, c, d, e, f]: Matrix, [x, y]: Point): Point {
  return [a * x + c * y + e, b * x + d * y + f];
}

export function toImage(matrix: Matrix, [x, y]: Point): Point {
  const [a, b, c, d, e, f] = matrix;
  const size = a * d - b * c;
  return [(d * (x - e) - c * (y - f)) / size, (a * (y - f) - b * (x - e)) / size];
}

/** The picture follows the finger. */
export function panned(view: View, image: Size, place: Size, by: Point): View {
  const [a, b, c, d] = matrixOf(view, image, place);
  const [x, y] = toImage([a, b, c, d, 0, 0], by);
  return bounded({ ...view, centre: [view.centre[0] - x, view.centre[1] - y] }, image);
}

/** Zoomed by a factor; what is at `at` on the screen stays there. */
export function zoomed(view: View, image: Size, place: Size, at: Point, factor: number): View {
  const zoom = boundedZoom(view.zoom * factor);
  const fixed = toImage(matrixOf(view, image, place), at);
  const share = view.zoom / zoom;
  const centre: Point = [
    fixed[0] + (view.centre[0] - fixed[0]) * share,
    fixed[1] + (view.centre[1] - fixed[1]) * share,
  ];
  return bounded({ ...view, zoom, centre }, image);
}

export function boundedZoom(zoom: number): number {
  return Math.min(Math.max(zoom, LEAST_ZOOM), MOST_ZOOM);
}

/** Two fingers went from one pair of places to another. */
export function pinched(
  view: View,
  image: Size,
  place: Size,
  before: readonly [Point, Point],
  after: readonly [Point, Point],
): View {
  const factor = distance(...after) / Math.max(distance(...before), 1);
  const [from, to] = [middle(...before), middle(...after)];
  return zoomed(panned(view, image, place, [to[0] - from[0], to[1] - from[1]]), image, place, to, factor);
}

/** A quarter turn clockwise, as one sees it: a mirrored picture turns the other way inside. */
export function turned(view: View): View {
  return { ...view, quarterTurns: (view.quarterTurns + (view.mirrored ? 3 : 1)) % 4 };
}

export function mirrored(view: View): View {
  return { ...view, mirrored: !view.mirrored };
}

/** Some of the picture is always in the middle. */
function bounded(view: View, image: Size): View {
  const [x, y] = view.centre;
  return {
    ...view,
    centre: [Math.min(Math.max(x, 0), image.width), Math.min(Math.max(y, 0), image.height)],
  };
}

function turn(quarterTurns: number): Point {
  const turns: readonly Point[] = [
    [1, 0],
    [0, 1],
    [-1, 0],
    [0, -1],
  ];
  return turns[((quarterTurns % 4) + 4) % 4] ?? [1, 0];
}

export function distance(p: Point, q: Point): number {
  return Math.hypot(p[0] - q[0], p[1] - q[1]);
}

export function middle(p: Point, q: Point): Point {
  return [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2];
}
