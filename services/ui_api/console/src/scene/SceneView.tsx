// The scene as a picture; loaded only where the browser can draw it.
import { Canvas, useThree } from "@react-three/fiber";
import { memo, useEffect, useLayoutEffect, useRef } from "react";
import Axes from "./Axes";
import CArm, { Rays } from "./CArm";
import CameraRig from "./CameraRig";
import { type Label, LabelFollower } from "./Labels";
import { LOOK } from "./looks";
import Patient from "./Patient";
import Robot from "./Robot";
import type { SceneModel, Stance } from "./sceneModel";
import { directionsOf, isAlong, type ViewId, viewOf } from "./views";

interface Props {
  readonly model: SceneModel;
  readonly head_extension_mm: number;
  readonly source_to_detector_mm: number;
  readonly ghost: Stance | null;
  readonly isLive: boolean;
  /** Drawn by the processor: one pixel of the picture a pixel of the page, and edges that are not smoothed. */
  readonly isCoarse: boolean;
  readonly view: ViewId;
  readonly asked: number;
  readonly labels: readonly Label[];
  readonly name: string;
  readonly onTurned: () => void;
  readonly onLost: () => void;
}

const FINE: [number, number] = [1, 2];

/** Asked to draw only when something of it has changed: what surrounds it is asked four times a second. */
export default memo(SceneView);

function SceneView(props: Props) {
  const { model, labels, name, isCoarse, onLost } = props;
  const elements = useRef<(HTMLElement | null)[]>([]);
  return (
    <>
      <Canvas
        frameloop="demand"
        dpr={isCoarse ? 1 : FINE}
        gl={{ antialias: !isCoarse, alpha: true, powerPreference: "high-performance" }}
        camera={{ fov: 30, near: 5, far: 4000 }}
        flat
        aria-label={name}
        role="img"
      >
        <Drawing onLost={onLost} drawn={[model, props.ghost, props.isLive, props.view, labels]} />
        <CameraRig view={viewOf(model, props.view)} asked={props.asked} onTurned={props.onTurned} />
        <LabelFollower labels={labels} elements={elements} />
        <Content {...props} />
      </Canvas>
      <div className="scene-labels" aria-hidden="true">
        {labels.map((label, index) => (
          <span
            key={label.text}
            ref={(element) => {
              elements.current[index] = element;
            }}
          >
            <b>{label.text}</b>
          </span>
        ))}
      </div>
    </>
  );
}

/** Draws anew when something has changed, and says when the graphics are lost. */
function Drawing({ onLost, drawn }: { onLost: () => void; drawn: readonly unknown[] }) {
  const { gl, invalidate } = useThree();
  // biome-ignore lint/correctness/useExhaustiveDependencies: these are what is drawn.
  useLayoutEffect(() => invalidate(), drawn);
  useEffect(() => {
    const canvas = gl.domElement;
    canvas.tabIndex = 0;
    canvas.addEventListener("webglcontextlost", onLost);
    return () => canvas.removeEventListener("webglcontextlost", onLost);
  }, [gl, onLost]);
  return null;
}

function Content({ model, head_extension_mm, source_to_detector_mm, ghost, isLive, view }: Props) {
  const { parts, seen, now, mount } = model;
  const isAlongHole = isAlong(view);
  const { away, up } = directionsOf(model);
  const down = up.clone().multiplyScalar(-1);
  const lamp = up.clone().addScaledVector(away, -1.2);
  return (
    <>
      <hemisphereLight args={["#ffffff", "#34404c", 1.6]} position={up} />
      <directionalLight intensity={1.8} position={lamp} />
      {now && !isAlongHole && (
        <Robot
          parts={parts}
          stance={now}
          mount={mount}
          head_extension_mm={head_extension_mm}
          {...(isLive ? {} : { look: LOOK.stale })}
        />
      )}
      {ghost && !isAlongHole && (
        <Robot
          parts={parts}
          stance={ghost}
          mount={mount}
          head_extension_mm={model.motion?.head_extension_mm ?? head_extension_mm}
          look={LOOK.ghost}
        />
      )}
      {seen && <Patient nail={parts.nail} seen={seen} showsBone={!isAlongHole} />}
      {seen && view === "room" && (
        <CArm seen={seen} ring={parts.ring} down={down} usual_source_to_detector_mm={source_to_detector_mm} />
      )}
      {seen && !isAlongHole && <Rays seen={seen} />}
      <Axes model={model} isAlongHole={isAlongHole} />
    </>
  );
}
