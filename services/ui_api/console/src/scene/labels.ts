// Words in the scene, as elements of the page over the canvas: they stay sharp, and are translated like the rest.
import type { Camera, Vector3 } from "three";
import type { Size } from "../image/view";

export interface Label {
  readonly text: string;
  readonly at_mm: Vector3;
}

/** Beyond this share of the way from the middle to the edge a point counts as not seen. */
const EDGE = 0.95;

/**
 * Where a word stands in CSS pixels from the left and from the top; null when its point is not seen. A word at the edge
 * stands beside its point rather than being cut off.
 */
export function labelPlace(
  at_mm: Vector3,
  camera: Camera,
  size: Size,
  labelWidth: number,
): readonly [left: number, top: number] | null {
  const { x, y, z } = at_mm.clone().project(camera);
  if (z > 1 || Math.abs(x) > EDGE || Math.abs(y) > EDGE) return null;
  const half = Math.min(labelWidth / 2, size.width / 2);
  const left = ((x + 1) / 2) * size.width;
  return [Math.min(Math.max(left, half), size.width - half), ((1 - y) / 2) * size.height];
}

/** Move the words' elements to where their points are seen. */
export function placeLabels(
  labels: readonly Label[],
  elements: readonly (HTMLElement | null)[],
  camera: Camera,
  size: Size,
): void {
  camera.updateMatrixWorld();
  const widths = elements.map((element) => element?.firstElementChild?.clientWidth ?? 0); // all read before any moves
  labels.forEach((label, index) => {
    const element = elements[index];
    if (!element) return;
    const place = labelPlace(label.at_mm, camera, size, widths[index] ?? 0);
    element.style.visibility = place === null ? "hidden" : "visible";
    if (place) element.style.transform = `translate(${place[0].toFixed(1)}px, ${place[1].toFixed(1)}px)`;
  });
}
