import type { ReactNode } from "react";
import { useTranslation } from "react-i18next";
import type { ImageView, LocalisationView } from "../api/types";
import { ageText } from "./ages";

interface Props {
  readonly image: ImageView | null;
  /** Of this image, or null. */
  readonly localisation: LocalisationView | null;
  readonly ageS: number | null;
  readonly isFluoroscopy: boolean;
  readonly isLive: boolean;
  readonly children?: ReactNode;
}

/** How old the picture is, and what was made of it: one line, words before colours. */
export default function ImageStatus({ image, localisation, ageS, isFluoroscopy, isLive, children }: Props) {
  const { t } = useTranslation();
  return (
    <div className="image-status">
      <p className="age">
        {isFluoroscopy && <strong className="running">{t("image.state.running")}</strong>}
        {ageS !== null && t("image.state.age", { age: ageText(ageS) })}
      </p>
      <Verdict image={image} localisation={localisation} isFluoroscopy={isFluoroscopy} />
      {children}
      {!isLive && (
        <p className="not-live" role="alert">
          {t("image.state.not_live")}
        </p>
      )}
    </div>
  );
}

function Verdict({ image, localisation, isFluoroscopy }: Omit<Props, "ageS" | "isLive" | "children">) {
  const { t } = useTranslation();
  if (localisation !== null) return <Localised localisation={localisation} />;
  if (isFluoroscopy) return null;
  if (image?.skipped) return <p className="verdict rejected">{image.skipped.message}</p>;
  return <p className="verdict waiting">{t("image.state.measuring")}</p>;
}

function Localised({ localisation }: { readonly localisation: LocalisationView }) {
  const { t } = useTranslation();
  if (localisation.verdict === "rejected")
    return (
      <p className="verdict rejected">
        <strong>{t("image.state.rejected")}</strong>{" "}
        {localisation.reasons.map((reason) => reason.message).join("; ")}
      </p>
    );
  if (localisation.validity === "stale")
    return (
      <p className="verdict stale-result">
        <strong>{t("image.state.stale")}</strong> {localisation.stale_because}
      </p>
    );
  return <p className="verdict accepted">{t("image.state.accepted")}</p>;
}
