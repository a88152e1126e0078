// From fingers on the picture to what they mean.
import { type RefObject, useEffect, useRef } from "react";
import type { Point } from "./view";

export interface GestureHandlers {
  /** The first finger went down. */
  readonly onStart: (at: Point) => void;
  /** It moved by so much; alone. The right button of a mouse drags too, as `isSecondary`. */
  readonly onDrag: (at: Point, by: Point, isSecondary: boolean) => void;
  /** Two fingers went from places to places. */
  readonly onPinch: (before: readonly [Point, Point], after: readonly [Point, Point]) => void;
  readonly onWheel: (at: Point, delta: number) => void;
}

const RIGHT_BUTTON = 2;

/** Listen to an element. React would listen to wheels passively, and then the page would scroll too. */
export function useGestures(element: RefObject<HTMLElement | null>, handlers: GestureHandlers): void {
  const newest = useRef(handlers);
  useEffect(() => {
    newest.current = handlers;
  });
  useEffect(() => {
    if (element.current === null) return;
    return listen(element.current, newest);
  }, [element]);
}

function listen(element: HTMLElement, handlers: RefObject<GestureHandlers>): () => void {
  const fingers = new Map<number, Point>();
  const leaving = new AbortController();
  const { signal } = leaving;

  function onDown(event: PointerEvent) {
    element.setPointerCapture(event.pointerId);
    const at = placeOf(event, element);
    fingers.set(event.pointerId, at);
    if (fingers.size === 1) handlers.current.onStart(at);
  }

  function onMove(event: PointerEvent) {
    const before = fingers.get(event.pointerId);
    if (before === undefined) return;
    const at = placeOf(event, element);
    const other = [...fingers].find(([id]) => id !== event.pointerId)?.[1];
    fingers.set(event.pointerId, at);
    if (other === undefined)
      handlers.current.onDrag(
        at,
        [at[0] - before[0], at[1] - before[1]],
        (event.buttons & RIGHT_BUTTON) !== 0,
      );
    else if (fingers.size === 2) handlers.current.onPinch([before, other], [at, other]);
  }

  const onUp = (event: PointerEvent) => fingers.delete(event.pointerId);
  element.addEventListener("pointerdown", onDown, { signal });
  element.addEventListener("pointermove", onMove, { signal });
  element.addEventListener("pointerup", onUp, { signal });
  element.addEventListener("pointercancel", onUp, { signal });
  element.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
  element.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      handlers.current.onWheel(placeOf(event, element), event.deltaY);
    },
    { signal, passive: false },
  );
  return () => leaving.abort();
}

function placeOf(event: MouseEvent, element: HTMLElement): Point {
  const place = element.getBoundingClientRect();
  return [event.clientX - place.left, event.clientY - place.top];
}
