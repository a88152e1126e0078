// Rigid transforms between named frames: `a_from_b` maps coordinates of frame b to frame a, so that chains cancel.
import { Matrix4, Vector3 } from "three";

export type Frame = "base" | "top" | "guide" | "nail" | "camera" | "ring";
export type Point = readonly [number, number, number];
/** As matrices are sent: rows first, in mm. */
export type Rows = readonly (readonly number[])[];

/** A product in the wrong order is a type error. */
export class Transform<To extends Frame, From extends Frame> {
  declare readonly to: To;
  declare readonly from: From;

  constructor(readonly matrix: Matrix4) {}

  /** From a matrix as it is sent, 4 x 4. */
  static ofRows<To extends Frame, From extends Frame>(rows: Rows): Transform<To, From> {
    // three.js keeps columns first.
    return new Transform(new Matrix4().fromArray(rows.flat()).transpose());
  }

  /** From a rotation, 3 x 3, and a translation in mm. */
  static ofRotation<To extends Frame, From extends Frame>(
    rotation: Rows,
    translation_mm: Point,
  ): Transform<To, From> {
    const rows = rotation.map((row, index) => [...row, translation_mm[index] ?? 0]);
    return Transform.ofRows([...rows, [0, 0, 0, 1]]);
  }

  after<Next extends Frame>(other: Transform<From, Next>): Transform<To, Next> {
    return new Transform(this.matrix.clone().multiply(other.matrix));
  }

  inverse(): Transform<From, To> {
    return new Transform(this.matrix.clone().invert());
  }

  point(point_mm: Point | Vector3): Vector3 {
    return vector(point_mm).applyMatrix4(this.matrix);
  }

  /** A unit vector, turned. */
  direction(direction: Point | Vector3): Vector3 {
    return vector(direction).transformDirection(this.matrix);
  }
}

export function vector(point: Point | Vector3): Vector3 {
  return point instanceof Vector3 ? point.clone() : new Vector3(...point);
}
