// Bounds of an axis from its predicted errors.
import { bound95Mm } from "../procedure/approval";

/** What results state of an axis: root mean squares over both directions across it (docs/results.md). */
export interface AxisUncertainty {
  readonly entry_mm: number;
  readonly axis_deg: number;
}

/** Cones are hundredths of a millimetre wide: to be seen at all they are drawn so many times as wide. */
export const CONE_MAGNIFICATION = 10;

/** Radius within which the true axis lies with 95 %, at a distance along it from the entry. */
export function radius95Mm(uncertainty: AxisUncertainty, way_mm: number): number {
  const lever_mm = way_mm * Math.tan((uncertainty.axis_deg * Math.PI) / 180);
  return bound95Mm(0, Math.hypot(uncertainty.entry_mm, lever_mm));
}

/** Bound of an offset in 95 of 100 cases. */
export function offsetBound95Mm(offset_mm: number, uncertainty: AxisUncertainty): number {
  return bound95Mm(offset_mm, uncertainty.entry_mm);
}

/** Bound of an angle in 95 of 100 cases. */
export function angleBound95Deg(angle_deg: number, uncertainty: AxisUncertainty): number {
  // Both directions of a tilt are a plane like those of an offset.
  return bound95Mm(angle_deg, uncertainty.axis_deg);
}
