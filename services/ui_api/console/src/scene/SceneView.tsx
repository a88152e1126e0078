// The scene as a picture. Another thread draws it; here are its canvas, its camera and its words.
import { type RefObject, useEffect, useLayoutEffect, useRef, useState } from "react";
import type { Vector3 } from "three";
import { usePlaceSize } from "../image/usePlaceSize";
import { Drawer } from "./drawer";
import type { Drawn, NoPicture } from "./drawing";
import { type Label, placeLabels } from "./labels";
import { Orbit } from "./orbit";
import type { SceneModel } from "./sceneModel";
import { type View, viewOf } from "./views";

interface Props extends Omit<Drawn, "size" | "camera"> {
  readonly model: SceneModel;
  /** Changes when the same view is asked for again after the hand has turned it. */
  readonly asked: number;
  readonly labels: readonly Label[];
  readonly name: string;
  readonly onTurned: () => void;
  readonly onNone: (why: NoPicture) => void;
}

interface Drawing {
  readonly drawer: Drawer;
  readonly orbit: Orbit;
}

export default function SceneView(props: Props) {
  const { model, labels, name, asked } = props;
  const place = useRef<HTMLDivElement>(null);
  const words = useRef<(HTMLElement | null)[]>([]);
  const size = usePlaceSize(place);
  const moved = useRef<() => void>(() => undefined);
  const drawing = useDrawing(place, moved, props);
  const { drawer, orbit } = drawing ?? { drawer: null, orbit: null };
  const view = viewOf(model, props.view);
  const aspect = size.width / Math.max(size.height, 1);

  useTold(drawer, props);
  useEffect(() => {
    drawer?.tell({ size: { ...size, pixelRatio: globalThis.devicePixelRatio } });
  }, [drawer, size]);
  useEffect(() => drawer?.canvas.setAttribute("aria-label", name), [drawer, name]);
  useLayoutEffect(() => {
    if (drawer === null || orbit === null) return;
    moved.current = () => {
      drawer.tell({ camera: orbit.place() });
      placeLabels(labels, words.current, orbit.camera, size);
    };
    moved.current();
  }, [drawer, orbit, labels, size]);
  // biome-ignore lint/correctness/useExhaustiveDependencies: the key is what of the view counts, rounded.
  useLayoutEffect(() => {
    orbit?.put(view, aspect);
    moved.current();
  }, [orbit, `${asked} ${keyOf(view)}`, aspect]);

  return (
    <>
      <div ref={place} className="scene-canvas" />
      <div className="scene-labels" aria-hidden="true">
        {labels.map((label, index) => (
          <span
            key={label.text}
            ref={(element) => {
              words.current[index] = element;
            }}
          >
            <b>{label.text}</b>
          </span>
        ))}
      </div>
    </>
  );
}

/** The drawing thread and the camera, for as long as the picture shows. */
function useDrawing(
  place: RefObject<HTMLElement | null>,
  moved: RefObject<() => void>,
  { onTurned, onNone }: Props,
): Drawing | null {
  const [drawing, setDrawing] = useState<Drawing | null>(null);
  useEffect(() => {
    if (place.current === null) return;
    const drawer = new Drawer(place.current, onNone);
    const orbit = new Orbit(drawer.canvas, () => moved.current(), onTurned);
    setDrawing({ drawer, orbit });
    return () => {
      orbit.end();
      drawer.end();
      setDrawing(null);
    };
  }, [place, moved, onTurned, onNone]);
  return drawing;
}

/** Tell what has changed, and only that: everything told is copied. */
function useTold(drawer: Drawer | null, drawn: Omit<Drawn, "size" | "camera">): void {
  const { parts, sources, source_to_detector_mm, ghostShare, isLive, view } = drawn;
  useEffect(() => drawer?.tell({ parts }), [drawer, parts]);
  useEffect(() => drawer?.tell({ sources }), [drawer, sources]);
  useEffect(() => drawer?.tell({ source_to_detector_mm }), [drawer, source_to_detector_mm]);
  useEffect(() => drawer?.tell({ ghostShare }), [drawer, ghostShare]);
  useEffect(() => drawer?.tell({ isLive }), [drawer, isLive]);
  useEffect(() => drawer?.tell({ view }), [drawer, view]);
}

/** Places that differ by less than half a millimetre are the same: a camera that creeps after the robot disturbs. */
function keyOf({ eye_mm, target_mm, up }: View): string {
  return [eye_mm, target_mm, up].map(roundedKey).join(" ");
}

function roundedKey(v: Vector3): string {
  return v
    .toArray()
    .map((value) => value.toFixed(value > 1 || value < -1 ? 0 : 2))
    .join(",");
}
