import { useTranslation } from "react-i18next";
import type { Me, RobotSnapshot } from "../api/types";

/** Said wherever robot, images or user are simulated. */
export default function Banner({
  me,
  robot,
}: {
  readonly me: Me | undefined;
  readonly robot: RobotSnapshot | null;
}) {
  const { t } = useTranslation();
  const simulated = robot?.view.simulated || robot?.view.image_source_simulated || Boolean(me?.banner);
  if (!simulated) return null;
  return (
    <p className="simulation" role="note">
      <strong>{t("state.simulation")}</strong> {t("state.simulation_means")}
    </p>
  );
}
