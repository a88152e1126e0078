import { Component, type ReactNode, useMemo, useState } from "react";
import { useTranslation } from "react-i18next";
import type { CaseView } from "../api/types";
import type { ScenePanelProps } from "../panels";
import type { NoPicture } from "./drawing";
import GhostControls from "./GhostControls";
import Legend from "./Legend";
import { leastSeconds, playedSeconds } from "./motion";
import Numbers from "./Numbers";
import { holeNumbers, nearestLeg } from "./numbers";
import SceneView from "./SceneView";
import { type SceneModel, type Sources, sceneModel } from "./sceneModel";
import { useSteadyState } from "./steady";
import { useGhost } from "./useGhost";
import { useParts } from "./useParts";
import { useSeen } from "./useSeen";
import { useView } from "./useView";
import ViewChoice, { viewName } from "./ViewChoice";
import { directionsOf, isAlong } from "./views";
import "./scene.css";

const USUAL_SOURCE_TO_DETECTOR_MM = 1000;

/** Robot, guide, nail and C-arm in space, and the numbers that count beside them. */
export default function ScenePanel(props: ScenePanelProps) {
  const { t } = useTranslation();
  const { caseView, robot, plan } = props;
  const parts = useParts(caseView);
  const localisation = useSeen(caseView, props.localisation);
  const state = useSteadyState(robot?.view.state ?? null);
  const setUp = useSetUp(caseView);
  const sources = useMemo(
    () => ({ caseView: setUp, robot: { state }, localisation, plan }),
    [setUp, state, localisation, plan],
  );
  const model = useMemo(() => parts && sceneModel(parts, sources), [parts, sources]);
  if (model === null) return <p className="empty">{t("scene.loading")}</p>;
  return (
    <section className="scene" aria-label={t("scene.title")}>
      <Space {...props} model={model} sources={sources} />
      <Numbers
        holes={holeNumbers(model, { localisation, plan, verification: props.verification })}
        travel={model.motion && (plan?.plan ?? null)}
        leg={nearestLeg(model, model.now)}
        plannedLeg={nearestLeg(model, model.planned)}
        isLive={props.isLive}
      />
    </section>
  );
}

/** What of a case is drawn; it is the same for as long as that is, though the case is read anew every 2 s. */
function useSetUp({ side, bone, mount, head_extension_mm, drill_diameter_mm, revision }: CaseView) {
  return useMemo(
    () => ({ side, bone, mount, head_extension_mm, drill_diameter_mm, revision }),
    [side, bone, mount, head_extension_mm, drill_diameter_mm, revision],
  );
}

type SpaceProps = ScenePanelProps & { readonly model: SceneModel; readonly sources: Sources };

/** The picture with its controls, or the sentence why there is none. */
function Space(props: SpaceProps) {
  const { t } = useTranslation();
  const [none, setNone] = useState<NoPicture | null>(null);
  if (none === null) return <Shown {...props} onNone={setNone} />;
  return (
    <p className="scene-missing" role="status">
      {t(none === "missing" ? "scene.graphics_missing" : "scene.graphics_lost")}
    </p>
  );
}

type ShownProps = SpaceProps & { readonly onNone: (why: NoPicture) => void };

function Shown({ model, sources, caseView, plan, isLive, showsGhost, onNone }: ShownProps) {
  const { t } = useTranslation();
  const view = useView();
  const { motion, parts } = model;
  const least_s = motion ? leastSeconds(parts.hexapod, motion.start, motion.target) : 0;
  const played_s = playedSeconds(least_s);
  const ghost = useGhost(motion && plan ? plan.sha256 : null, showsGhost, played_s);
  const labels = useMemo(() => labelsOf(model, (key) => t(key)), [model, t]);
  const holes = model.seen?.holes.map((hole) => hole.id) ?? [];
  return (
    <>
      <div className="scene-picture">
        <DrawingBoundary instead={<p className="scene-missing">{t("scene.graphics_lost")}</p>}>
          <SceneView
            model={model}
            parts={parts}
            sources={sources}
            source_to_detector_mm={caseView.nominal_source_to_detector_mm ?? USUAL_SOURCE_TO_DETECTOR_MM}
            ghostShare={motion && ghost.share}
            isLive={isLive}
            view={view.id}
            asked={view.asked}
            labels={labels}
            name={t("scene.picture", { view: viewName(view.id, t) })}
            onTurned={view.onTurned}
            onNone={onNone}
          />
        </DrawingBoundary>
        {!isLive && <p className="scene-stale">{t("scene.not_live")}</p>}
        {motion && ghost.share !== null && <p className="scene-ghost">{t("scene.ghost_is")}</p>}
      </div>
      <ViewChoice holes={holes} chosen={view.isTurned ? null : view.id} choose={view.choose} />
      {motion && <GhostControls ghost={ghost} faster={least_s / played_s} />}
      <Legend model={model} isAlongHole={isAlong(view.id)} />
    </>
  );
}

function labelsOf(model: SceneModel, t: (key: string) => string) {
  const { distal } = directionsOf(model);
  const { seen } = model;
  if (seen === null) return [];
  const tip = seen.base_from_nail.point([model.parts.nail.tip_x_mm, 0, 0]);
  return [
    { text: t("scene.distal"), at_mm: tip.clone().addScaledVector(distal, 48) },
    { text: t("scene.proximal"), at_mm: tip.clone().addScaledVector(distal, -150) },
  ];
}

interface BoundaryProps {
  readonly instead: ReactNode;
  readonly children: ReactNode;
}

/** A picture that cannot be drawn takes nothing else with it. */
class DrawingBoundary extends Component<BoundaryProps, { readonly hasFailed: boolean }> {
  override state = { hasFailed: false };

  static getDerivedStateFromError() {
    return { hasFailed: true };
  }

  override render() {
    return this.state.hasFailed ? this.props.instead : this.props.children;
  }
}
