// Lines in space, and how far one is from another as results count it (docs/results.md).
import { MathUtils, type Vector3 } from "three";

export interface Line {
  readonly point_mm: Vector3;
  /** Of length 1. */
  readonly direction: Vector3;
}

export function along(line: Line, way_mm: number): Vector3 {
  return line.point_mm.clone().addScaledVector(line.direction, way_mm);
}

/** Where a line meets the plane across an axis through a point of it; null when it runs in the plane. */
export function crossing(line: Line, axis: Line, at_mm: Vector3): Vector3 | null {
  const steepness = line.direction.dot(axis.direction);
  if (Math.abs(steepness) < 1e-6) return null;
  return along(line, at_mm.clone().sub(line.point_mm).dot(axis.direction) / steepness);
}

/** Distance across the axis at a point of it, in mm; infinite when the line never comes there. */
export function offsetAcross(line: Line, axis: Line, at_mm: Vector3): number {
  return crossing(line, axis, at_mm)?.distanceTo(at_mm) ?? Number.POSITIVE_INFINITY;
}

/** Angle between two axes, whichever way they point: 0 to 90°. */
export function angleBetweenDeg(one: Vector3, other: Vector3): number {
  const angle = MathUtils.radToDeg(one.angleTo(other));
  return Math.min(angle, 180 - angle);
}
