// What the drawing thread draws.
import { useMemo } from "react";
import Axes from "./Axes";
import CArm, { Rays } from "./CArm";
import type { Drawn } from "./drawing";
import { LOOK } from "./looks";
import Patient from "./Patient";
import Robot from "./Robot";
import { ghostStance, sceneModel } from "./sceneModel";
import { directionsOf, isAlong } from "./views";

/** Everything that stands in the room, in the frame of the robot's base. */
export default function SceneContent(drawn: Drawn) {
  const { parts, sources, ghostShare, isLive, view } = drawn;
  const model = useMemo(() => sceneModel(parts, sources), [parts, sources]);
  const ghost = useMemo(() => ghostStance(model, ghostShare), [model, ghostShare]);
  const { seen, now, mount } = model;
  const isAlongHole = isAlong(view);
  const { away, up } = directionsOf(model);
  const down = up.clone().multiplyScalar(-1);
  const lamp = up.clone().addScaledVector(away, -1.2);
  const { head_extension_mm } = sources.caseView;
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
        <CArm
          seen={seen}
          ring={parts.ring}
          down={down}
          usual_source_to_detector_mm={drawn.source_to_detector_mm}
        />
      )}
      {seen && !isAlongHole && <Rays seen={seen} />}
      <Axes model={model} isAlongHole={isAlongHole} />
    </>
  );
}
