import { type RefObject, useLayoutEffect, useState } from "react";
import type { Size } from "./view";

/** Size of an element in CSS pixels, as it changes. */
export function usePlaceSize(element: RefObject<HTMLElement | null>): Size {
  const [size, setSize] = useState<Size>({ width: 1, height: 1 });
  useLayoutEffect(() => {
    const observed = element.current;
    if (observed === null) return;
    const take = () => setSize({ width: observed.clientWidth, height: observed.clientHeight });
    take();
    const observer = new ResizeObserver(take);
    observer.observe(observed);
    return () => observer.disconnect();
  }, [element]);
  return size;
}
