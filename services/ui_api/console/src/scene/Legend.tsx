import { useTranslation } from "react-i18next";
import type { SceneModel } from "./sceneModel";
import { CONE_MAGNIFICATION } from "./uncertainty";

/** What the marks mean; a mark that is not there is not explained. */
export default function Legend({
  model,
  isAlongHole,
}: {
  readonly model: SceneModel;
  readonly isAlongHole: boolean;
}) {
  const { t } = useTranslation();
  const { seen, now, planned } = model;
  const marks = [
    seen && (["hole", t(isAlongHole ? "scene.mark.hole_along" : "scene.mark.hole")] as const),
    seen && now && (["now", t(isAlongHole ? "scene.mark.now_along" : "scene.mark.now")] as const),
    seen && planned && (["planned", t("scene.mark.planned")] as const),
    seen && !isAlongHole && (["cone", t("scene.mark.cone", { times: CONE_MAGNIFICATION })] as const),
    seen?.base_from_camera && !isAlongHole && (["ray", t("scene.mark.ray")] as const),
  ].filter((mark) => mark !== null && mark !== undefined && mark !== false);
  return (
    <>
      <ul className="scene-legend">
        {marks.map(
          (mark) =>
            mark && (
              <li key={mark[0]}>
                <i className={mark[0]} /> {mark[1]}
              </li>
            ),
        )}
      </ul>
      <p className="scene-note">{t(seen ? "scene.schematic" : "scene.no_nail")}</p>
    </>
  );
}
