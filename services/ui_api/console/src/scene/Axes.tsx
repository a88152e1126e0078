import { useMemo } from "react";
import { LatheGeometry, Quaternion, Vector2, Vector3 } from "three";
import { along, crossing, type Line } from "./lines";
import { LOOK, OVER, SHAPE } from "./looks";
import { Circle, Rod } from "./pieces";
import { guideAxis, play_mm, type SceneModel, type SeenHole } from "./sceneModel";
import { type AxisUncertainty, CONE_MAGNIFICATION, radius95Mm } from "./uncertainty";

interface Props {
  readonly model: SceneModel;
  /** Along a hole the axes are points: circles where they cross the nail are what counts. */
  readonly isAlongHole: boolean;
}

const BEYOND_MM = 22;
const BEFORE_MM = 150;
const CONE_MM = { out: 95, in: 40 };

/** Of each hole: the nail's axis with its uncertainty, the guide's now, and the guide's after the planned move. */
export default function Axes({ model, isAlongHole }: Props) {
  return model.seen?.holes.map((hole) => (
    <group key={hole.id}>
      <HoleAxis hole={hole} model={model} isAlongHole={isAlongHole} />
      <GuideAxis
        hole={hole}
        axis={model.now && guideAxis(model.parts.guide, model.now, hole.id)}
        look="now"
        isAlongHole={isAlongHole}
        model={model}
      />
      <GuideAxis
        hole={hole}
        axis={model.planned && guideAxis(model.parts.guide, model.planned, hole.id)}
        look="planned"
        isAlongHole={isAlongHole}
        model={model}
      />
    </group>
  ));
}

function HoleAxis({ hole, model, isAlongHole }: { hole: SeenHole } & Props) {
  const { axis, exit_mm } = hole;
  const play = play_mm(hole, model.drill_diameter_mm);
  return (
    <>
      {!isAlongHole && (
        <Rod
          from_mm={along(axis, -CONE_MM.out)}
          to_mm={along(axis, CONE_MM.in)}
          radius_mm={0.35}
          look={LOOK.hole}
        />
      )}
      {hole.uncertainty && <Cone axis={axis} uncertainty={hole.uncertainty} isAlongHole={isAlongHole} />}
      {play > 0 &&
        [axis.point_mm, exit_mm].map((at_mm, index) => (
          <Circle
            key={index === 0 ? "entry" : "exit"}
            at_mm={at_mm}
            across={axis.direction}
            radius_mm={play}
            thickness_mm={0.07}
            look={OVER.hole}
          />
        ))}
      <Circle
        at_mm={axis.point_mm}
        across={axis.direction}
        radius_mm={hole.diameter_mm / 2}
        thickness_mm={0.12}
        look={OVER.hole}
      />
    </>
  );
}

interface GuideAxisProps extends Props {
  readonly hole: SeenHole;
  readonly axis: Line | null;
  readonly look: "now" | "planned";
}

/** As a rod from the guide through the nail; seen along the hole, as what a drill would fill at entry and exit. */
function GuideAxis({ hole, axis, look, isAlongHole, model }: GuideAxisProps) {
  if (axis === null) return null;
  const entry_mm = crossing(axis, hole.axis, hole.axis.point_mm);
  const exit_mm = crossing(axis, hole.axis, hole.exit_mm);
  if (entry_mm === null || exit_mm === null) return null;
  const radius_mm = model.drill_diameter_mm / 2;
  if (!isAlongHole)
    return (
      <Rod
        from_mm={along({ point_mm: entry_mm, direction: axis.direction }, -BEFORE_MM)}
        to_mm={along({ point_mm: exit_mm, direction: axis.direction }, BEYOND_MM)}
        radius_mm={look === "now" ? 0.55 : 0.8}
        look={LOOK[look]}
        shape={look === "now" ? SHAPE.rod : SHAPE.dashes}
      />
    );
  return (
    <>
      <Circle
        at_mm={entry_mm}
        across={axis.direction}
        radius_mm={radius_mm}
        thickness_mm={0.14}
        look={OVER[look]}
      />
      <Circle
        at_mm={exit_mm}
        across={axis.direction}
        radius_mm={radius_mm}
        thickness_mm={0.07}
        look={OVER[look]}
      />
      <Rod from_mm={entry_mm} to_mm={exit_mm} radius_mm={0.14} look={LOOK[look]} />
    </>
  );
}

/** Where the true axis lies with 95 %, drawn wider than it is. */
function Cone({
  axis,
  uncertainty,
  isAlongHole,
}: {
  axis: Line;
  uncertainty: AxisUncertainty;
  isAlongHole: boolean;
}) {
  const { entry_mm, axis_deg } = uncertainty;
  const shape = useMemo(() => {
    const ways = isAlongHole ? [0, 1] : [-CONE_MM.out, -60, -30, 0, CONE_MM.in];
    const scale = isAlongHole ? 1 : CONE_MAGNIFICATION;
    return new LatheGeometry(
      ways.map((way) => new Vector2(scale * radius95Mm({ entry_mm, axis_deg }, way), way)),
      24,
    );
  }, [entry_mm, axis_deg, isAlongHole]);
  const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), axis.direction);
  return (
    <mesh geometry={shape} material={LOOK.cone} position={axis.point_mm} quaternion={turn} renderOrder={4} />
  );
}
