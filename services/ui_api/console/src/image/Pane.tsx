import { type Dispatch, useRef } from "react";
import { useGestures } from "./gestures";
import Overlay from "./Overlay";
import PictureCanvas from "./PictureCanvas";
import type { Pixels } from "./pixels";
import Ruler, { type RulerLine } from "./Ruler";
import type { ImageDrawing } from "./results";
import { endNear, type Scales } from "./ruler";
import type { Settings, SettingsEvent } from "./settings";
import { usePlaceSize } from "./usePlaceSize";
import { type Matrix, matrixOf, type Point, panned, pinched, toImage, toScreen, zoomed } from "./view";

/** A picture and what was found in it. */
export interface Shown {
  readonly pixels: Pixels;
  readonly drawing: ImageDrawing | null;
  readonly label: string;
}

interface Props {
  readonly shown: Shown;
  /** Lies over the other, left of the wiper. */
  readonly before?: Shown | null;
  readonly isLabelled?: boolean;
  readonly settings: Settings;
  readonly dispatch: Dispatch<SettingsEvent>;
  readonly ruler: RulerLine | null;
  readonly onRuler: (line: RulerLine) => void;
  readonly scales: Scales | null;
}

const FINGER_PX = 30;
const WHEEL_STEP = 0.0015;

/** A place with a picture that follows fingers. */
export default function Pane({
  shown,
  before = null,
  isLabelled = false,
  settings,
  dispatch,
  ruler,
  onRuler,
  scales,
}: Props) {
  const place = useRef<HTMLDivElement>(null);
  const size = usePlaceSize(place);
  const { pixels } = shown;
  const matrix = matrixOf(settings.view, pixels, size);
  const held = useRef<{ view: typeof settings.view; line: RulerLine | null; end: 0 | 1 }>({
    view: settings.view,
    line: null,
    end: 1,
  });
  // Several moves may come before the page is drawn anew.
  held.current.view = settings.view;

  function show(view: typeof settings.view) {
    held.current.view = view;
    dispatch({ kind: "view", view });
  }

  function startRuler(at: Point) {
    const ends = ruler && ([toScreen(matrix, ruler[0]), toScreen(matrix, ruler[1])] as const);
    const end = ends && endNear(ends, at, FINGER_PX);
    held.current.line = end !== null && ruler ? ruler : [toImage(matrix, at), toImage(matrix, at)];
    held.current.end = end ?? 1;
  }

  function moveRuler(at: Point) {
    const { line, end } = held.current;
    if (line === null) return;
    const point = toImage(matrix, at);
    held.current.line = end === 0 ? [point, line[1]] : [line[0], point];
    onRuler(held.current.line);
  }

  useGestures(place, {
    onStart: (at) => settings.drag === "ruler" && startRuler(at),
    onDrag: (at, by, isSecondary) => {
      if (isSecondary || settings.drag === "grey")
        dispatch({ kind: "grey", byShare: [by[0] / size.width, by[1] / size.height] });
      else if (settings.drag === "ruler") moveRuler(at);
      else show(panned(held.current.view, pixels, size, by));
    },
    onPinch: (from, to) => show(pinched(held.current.view, pixels, size, from, to)),
    onWheel: (at, delta) => show(zoomed(held.current.view, pixels, size, at, Math.exp(-WHEEL_STEP * delta))),
  });

  return (
    <div ref={place} className={`stage drag-${settings.drag}`} role="img" aria-label={shown.label}>
      <Layer shown={shown} settings={settings} matrix={matrix} />
      {before && (
        <div className="wiped" style={{ clipPath: `inset(0 ${100 * (1 - settings.wiper)}% 0 0)` }}>
          <Layer shown={before} settings={settings} matrix={matrixOf(settings.view, before.pixels, size)} />
        </div>
      )}
      {before && <p className="side-label left">{before.label}</p>}
      {isLabelled && <p className="side-label right">{shown.label}</p>}
      {ruler && (
        <Ruler line={ruler} matrix={matrix} scales={scales} isCorrected={pixels.view === "corrected"} />
      )}
    </div>
  );
}

interface LayerProps {
  readonly shown: Shown;
  readonly settings: Settings;
  readonly matrix: Matrix;
}

function Layer({ shown, settings, matrix }: LayerProps) {
  return (
    <>
      <PictureCanvas pixels={shown.pixels} grey={settings.grey} matrix={matrix} />
      {settings.showsOverlay && shown.drawing && (
        <Overlay drawing={shown.drawing} view={shown.pixels.view} matrix={matrix} />
      )}
    </>
  );
}
