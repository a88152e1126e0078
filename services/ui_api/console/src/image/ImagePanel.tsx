import { useTranslation } from "react-i18next";
import { useLive } from "../api/useLive";
import type { ImagePanelProps } from "../panels";

/** The newest image of the case. */
export default function ImagePanel({ newestImage, localisation }: ImagePanelProps) {
  const { t } = useTranslation();
  const live = useLive();
  const id = live?.image ?? newestImage?.id;
  if (id === undefined) return <p className="empty">{t("image.none")}</p>;
  const view = localisation?.image.sha256 === id ? "overlay" : "raw";
  return (
    <figure className="image">
      <img src={`/api/v1/images/${id}.png?view=${view}`} alt={t("image.newest")} />
    </figure>
  );
}
