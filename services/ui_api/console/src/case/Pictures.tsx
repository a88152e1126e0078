import { lazy } from "react";
import { useTranslation } from "react-i18next";
import ImagePanel from "../image/ImagePanel";
import type { ImagePanelProps } from "../panels";
import RobotPanel from "../robot/RobotPanel";

const ScenePanel = lazy(() => import("../scene/ScenePanel"));

/** The image in the middle; scene and robot to the right of it. */
export default function Pictures(results: ImagePanelProps) {
  const { t } = useTranslation();
  const { caseView, robot, isLive } = results;
  return (
    <>
      <section className="image-place" aria-label={t("image.title")}>
        <ImagePanel {...results} />
      </section>
      <aside className="right">
        <div className="scene-place">
          <ScenePanel {...results} showsGhost={caseView.procedure.phase === "approval"} />
        </div>
        <RobotPanel robot={robot} isLive={isLive} />
      </aside>
    </>
  );
}
