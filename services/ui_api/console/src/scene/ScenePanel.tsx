import { useTranslation } from "react-i18next";
import type { ScenePanelProps } from "../panels";

const DIGITS = 2;

/** Robot, guide and nail in space; here as numbers. */
export default function ScenePanel({ robot, isLive }: ScenePanelProps) {
  const { t } = useTranslation();
  const pose = robot?.view.state?.pose;
  if (!pose) return <p className="empty">{t("scene.none")}</p>;
  return (
    <dl className={isLive ? "pose" : "pose stale"}>
      {Object.entries(pose).map(([name, value]) => (
        <div key={name}>
          <dt>{t(`scene.pose.${name}`)}</dt>
          <dd>{value.toFixed(DIGITS)}</dd>
        </div>
      ))}
    </dl>
  );
}
