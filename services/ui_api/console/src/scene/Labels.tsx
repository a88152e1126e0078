// Words in the scene, as elements of the page over the canvas: they stay sharp, and are translated like the rest.
import { useFrame } from "@react-three/fiber";
import { useRef } from "react";
import { Vector3 } from "three";

export interface Label {
  readonly text: string;
  readonly at_mm: Vector3;
}

/** Of a word whose width is not known yet. */
const HALF_PX = 30;

interface FollowerProps {
  readonly labels: readonly Label[];
  readonly elements: React.RefObject<readonly (HTMLElement | null)[]>;
}

/** Inside the canvas: moves the elements to where their points are seen. */
export function LabelFollower({ labels, elements }: FollowerProps) {
  const seen = useRef(new Vector3());
  useFrame(({ camera, size }) => {
    labels.forEach((label, index) => {
      const element = elements.current[index];
      if (!element) return;
      const { x, y, z } = seen.current.copy(label.at_mm).project(camera);
      const left = ((x + 1) / 2) * size.width;
      const top = ((1 - y) / 2) * size.height;
      // A word at the edge stands beside its point rather than being cut off.
      const half = Math.min(element.offsetWidth / 2 || HALF_PX, size.width / 2);
      const inside = Math.min(Math.max(left, half), size.width - half);
      element.style.transform = `translate(${inside.toFixed(1)}px, ${top.toFixed(1)}px)`;
      element.hidden = z > 1 || Math.abs(x) > 0.95 || Math.abs(y) > 0.95;
    });
  });
  return null;
}
