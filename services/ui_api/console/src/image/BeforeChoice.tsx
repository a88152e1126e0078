import type { Dispatch } from "react";
import { useTranslation } from "react-i18next";
import type { ImageView } from "../api/types";
import { ageText } from "./ages";
import type { SettingsEvent } from "./settings";
import Thumbnail, { pictureAddress } from "./Thumbnail";

interface Props {
  readonly images: readonly ImageView[];
  readonly chosen: string | null;
  readonly dispatch: Dispatch<SettingsEvent>;
}

const THUMBNAIL_PX = 96;

/** Small pictures of the images that the newest one can be compared with. */
export default function BeforeChoice({ images, chosen, dispatch }: Props) {
  const { t } = useTranslation();
  return (
    <div className="before-choice" role="toolbar" aria-label={t("image.before.choose")}>
      {images.length === 0 && <p>{t("image.before.none")}</p>}
      {images.map((image) => (
        <button
          key={image.id}
          type="button"
          aria-pressed={image.id === chosen}
          onClick={() => dispatch({ kind: "before", image: image.id })}
        >
          <Thumbnail address={pictureAddress(image.id)} width_px={THUMBNAIL_PX} alt="" />
          {ageText(image.age_s)}
        </button>
      ))}
    </div>
  );
}
