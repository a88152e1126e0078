import { useEffect, useReducer, useState } from "react";
import { useTranslation } from "react-i18next";
import type { LocalisationView } from "../api/types";
import type { ImagePanelProps } from "../panels";
import { useAge } from "./ages";
import ImageStatus from "./ImageStatus";
import "./image.css";
import Magnifiers from "./Magnifiers";
import Pane from "./Pane";
import type { Pixels } from "./pixels";
import type { RulerLine } from "./Ruler";
import { useDrawing } from "./results";
import { scalesOf } from "./ruler";
import { FIRST_SETTINGS, settingsReducer } from "./settings";
import Toolbar from "./Toolbar";
import { useShown } from "./useShown";

/** The newest X-ray image with what was found in it. */
export default function ImagePanel(props: ImagePanelProps) {
  const { caseView, newestImage, localisation, isLive } = props;
  const { t } = useTranslation();
  const [settings, dispatch] = useReducer(settingsReducer, FIRST_SETTINGS);
  const { pixels, isAhead, live } = useShown(caseView, newestImage, localisation, settings.isCorrected);
  const liveAge = useAge(live?.image ?? null, live?.age_s ?? null);
  const storedAge = useAge(newestImage?.id ?? null, newestImage?.age_s ?? null);
  const ofShown = localisationOf(pixels, localisation);
  const width = pixels?.width ?? 0;
  const height = pixels?.height ?? 0;
  useEffect(() => dispatch({ kind: "whole", image: { width, height } }), [width, height]);
  if (pixels === null) return <p className="empty">{t(newestImage ? "image.loading" : "image.none")}</p>;
  return (
    <div className="xray">
      <ImageStatus
        image={newestImage}
        localisation={ofShown}
        ageS={isAhead ? liveAge : storedAge}
        isFluoroscopy={isAhead}
        isLive={isLive}
      />
      <Toolbar
        settings={settings}
        dispatch={dispatch}
        onWhole={() => dispatch({ kind: "whole", image: pixels })}
        canCorrect={ofShown?.camera != null}
        canCompare={false}
      />
      <Panes {...props} pixels={pixels} localisation={ofShown} settings={settings} dispatch={dispatch} />
    </div>
  );
}

/** The localisation, if it is of this picture. */
function localisationOf(
  pixels: Pixels | null,
  localisation: LocalisationView | null,
): LocalisationView | null {
  return localisation !== null && localisation.image.sha256 === pixels?.image ? localisation : null;
}

interface PanesProps extends ImagePanelProps {
  readonly pixels: Pixels;
  readonly settings: Parameters<typeof settingsReducer>[0];
  readonly dispatch: (event: Parameters<typeof settingsReducer>[1]) => void;
}

function Panes({ caseView, newestImage, localisation, pixels, settings, dispatch }: PanesProps) {
  const { t } = useTranslation();
  const [ruler, setRuler] = useState<RulerLine | null>(null);
  const drawing = useDrawing(caseView.id, localisation);
  return (
    <div className="panes">
      <Pane
        shown={{ pixels, drawing, label: t("image.newest") }}
        settings={settings}
        dispatch={dispatch}
        ruler={settings.drag === "ruler" ? ruler : null}
        onRuler={setRuler}
        scales={scalesOf(drawing, newestImage?.header?.nominal_pixel_mm ?? null)}
      />
      {settings.showsHoles && localisation && drawing && (
        <Magnifiers
          pixels={pixels}
          grey={settings.grey}
          view={settings.view}
          drawing={drawing}
          localisation={localisation}
        />
      )}
    </div>
  );
}
