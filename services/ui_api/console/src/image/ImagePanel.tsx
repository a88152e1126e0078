import { useEffect, useReducer, useState } from "react";
import { useTranslation } from "react-i18next";
import type { LocalisationView } from "../api/types";
import type { ImagePanelProps } from "../panels";
import { useAge } from "./ages";
import Bullseye from "./Bullseye";
import ImageStatus from "./ImageStatus";
import "./image.css";
import Panes from "./Panes";
import type { Pixels } from "./pixels";
import { FIRST_SETTINGS, settingsReducer } from "./settings";
import Toolbar from "./Toolbar";
import { useAdvice } from "./useAdvice";
import { useShown } from "./useShown";

/** The newest X-ray image with what was found in it, or how to turn the C-arm. */
export default function ImagePanel(props: ImagePanelProps) {
  const { caseView, newestImage, localisation, isLive } = props;
  const { t } = useTranslation();
  const [settings, dispatch] = useReducer(settingsReducer, FIRST_SETTINGS);
  const [isAiming, setAiming] = useState(false);
  const { pixels, isAhead, live } = useShown(caseView, newestImage, localisation, settings.isCorrected);
  const liveAge = useAgeOf(live && { id: live.image, age_s: live.age_s });
  const storedAge = useAgeOf(newestImage);
  const ofShown = localisationOf(pixels, localisation);
  const width = pixels?.width ?? 0;
  const height = pixels?.height ?? 0;
  useEffect(() => dispatch({ kind: "whole", image: { width, height } }), [width, height]);
  if (pixels === null) return <p className="empty">{t(newestImage ? "image.loading" : "image.none")}</p>;
  return (
    <div className={isAiming ? "xray aiming" : "xray"}>
      <ImageStatus
        image={newestImage}
        localisation={ofShown}
        ageS={isAhead ? liveAge : storedAge}
        isFluoroscopy={isAhead}
        isLive={isLive}
      >
        <button
          type="button"
          className="aim-button"
          aria-pressed={isAiming}
          onClick={() => setAiming(!isAiming)}
        >
          {t(isAiming ? "image.aim.back" : "image.aim.title")}
        </button>
      </ImageStatus>
      {isAiming ? (
        <Aim {...props} />
      ) : (
        <>
          <Toolbar
            settings={settings}
            dispatch={dispatch}
            onWhole={() => dispatch({ kind: "whole", image: pixels })}
            canCorrect={ofShown?.camera != null}
            canCompare={caseView.images > 1}
          />
          <Panes
            caseView={caseView}
            newestImage={newestImage}
            pixels={pixels}
            localisation={ofShown}
            settings={settings}
            dispatch={dispatch}
          />
        </>
      )}
    </div>
  );
}

function useAgeOf(image: { readonly id: string; readonly age_s: number | null } | null): number | null {
  return useAge(image?.id ?? null, image?.age_s ?? null);
}

function Aim({ caseView, localisation, isLive }: ImagePanelProps) {
  const advice = useAdvice(caseView.id, localisation);
  const ageS = useAge(advice?.of ?? null, advice?.ageS ?? null);
  return <Bullseye advice={advice} ageS={ageS} isLive={isLive} />;
}

/** The localisation, if it is of this picture. */
function localisationOf(
  pixels: Pixels | null,
  localisation: LocalisationView | null,
): LocalisationView | null {
  return localisation !== null && localisation.image.sha256 === pixels?.image ? localisation : null;
}
