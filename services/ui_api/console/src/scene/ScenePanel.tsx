import { Component, lazy, type ReactNode, Suspense, useCallback, useMemo, useState } from "react";
import { useTranslation } from "react-i18next";
import type { ScenePanelProps } from "../panels";
import GhostControls from "./GhostControls";
import { findGraphics, type Graphics } from "./graphics";
import Legend from "./Legend";
import { leastSeconds, playedSeconds, poseAlong } from "./motion";
import Numbers from "./Numbers";
import { holeNumbers, nearestLeg } from "./numbers";
import { type SceneModel, type Stance, sceneModel, stanceOf } from "./sceneModel";
import { useSteadyState } from "./steady";
import { useGhost } from "./useGhost";
import { useParts } from "./useParts";
import { useSeen } from "./useSeen";
import { useView } from "./useView";
import ViewChoice, { viewName } from "./ViewChoice";
import { directionsOf, isAlong } from "./views";
import "./scene.css";

const SceneView = lazy(() => import("./SceneView"));
const USUAL_SOURCE_TO_DETECTOR_MM = 1000;

/** Robot, guide, nail and C-arm in space, and the numbers that count beside them. */
export default function ScenePanel(props: ScenePanelProps) {
  const { t } = useTranslation();
  const { caseView, robot } = props;
  const parts = useParts(caseView);
  const localisation = useSeen(caseView, props.localisation);
  const state = useSteadyState(robot?.view.state ?? null);
  const plan = props.plan;
  const model = useMemo(
    () => parts && sceneModel(parts, { caseView, robot: { state }, localisation, plan }),
    [parts, caseView, state, localisation, plan],
  );
  if (model === null) return <p className="empty">{t("scene.loading")}</p>;
  return (
    <section className="scene" aria-label={t("scene.title")}>
      <Space {...props} model={model} />
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

type SpaceProps = ScenePanelProps & { readonly model: SceneModel };

/** The picture with its controls, or the sentence why there is none. */
function Space(props: SpaceProps) {
  const { t } = useTranslation();
  const [graphics] = useState(findGraphics);
  const [isLost, setLost] = useState(false);
  const onLost = useCallback(() => setLost(true), []);
  if (graphics !== "none" && !isLost) return <Drawn {...props} graphics={graphics} onLost={onLost} />;
  return (
    <p className="scene-missing" role="status">
      {t(graphics === "none" ? "scene.graphics_missing" : "scene.graphics_lost")}
    </p>
  );
}

type DrawnProps = SpaceProps & { readonly graphics: Graphics; readonly onLost: () => void };

function Drawn(props: DrawnProps) {
  const { model, caseView, plan, isLive, showsGhost, graphics, onLost } = props;
  const { t } = useTranslation();
  const view = useView();
  const { motion, parts } = model;
  const least_s = motion ? leastSeconds(parts.hexapod, motion.start, motion.target) : 0;
  const played_s = playedSeconds(least_s);
  const ghost = useGhost(motion && plan ? plan.sha256 : null, showsGhost, played_s);
  const stance = useMemo(() => ghostStance(model, ghost.share), [model, ghost.share]);
  const labels = useMemo(() => labelsOf(model, (key) => t(key)), [model, t]);
  const holes = model.seen?.holes.map((hole) => hole.id) ?? [];
  return (
    <>
      <div className="scene-picture">
        <DrawingBoundary instead={<p className="scene-missing">{t("scene.graphics_lost")}</p>}>
          <Suspense fallback={<p className="empty">{t("scene.loading")}</p>}>
            <SceneView
              model={model}
              head_extension_mm={caseView.head_extension_mm}
              source_to_detector_mm={caseView.nominal_source_to_detector_mm ?? USUAL_SOURCE_TO_DETECTOR_MM}
              ghost={stance}
              isLive={isLive}
              isCoarse={graphics === "processor"}
              view={view.id}
              asked={view.asked}
              labels={labels}
              name={t("scene.picture", { view: viewName(view.id, t) })}
              onTurned={view.onTurned}
              onLost={onLost}
            />
          </Suspense>
        </DrawingBoundary>
        {!isLive && <p className="scene-stale">{t("scene.not_live")}</p>}
        {stance && <p className="scene-ghost">{t("scene.ghost_is")}</p>}
      </div>
      <ViewChoice holes={holes} chosen={view.isTurned ? null : view.id} choose={view.choose} />
      {motion && <GhostControls ghost={ghost} faster={least_s / played_s} />}
      <Legend model={model} isAlongHole={isAlong(view.id)} />
    </>
  );
}

function ghostStance(model: SceneModel, share: number | null): Stance | null {
  const { motion, parts } = model;
  if (motion === null || share === null) return null;
  const pose = poseAlong(motion.start, motion.target, share);
  return stanceOf(parts.hexapod, pose, motion.pivot_mm, motion.head_extension_mm);
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
