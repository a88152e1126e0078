import { type Dispatch, useState } from "react";
import { useTranslation } from "react-i18next";
import type { CaseView, ImageView, LocalisationView } from "../api/types";
import { ageText } from "./ages";
import BeforeChoice from "./BeforeChoice";
import { useBefore } from "./before";
import Magnifiers from "./Magnifiers";
import Pane from "./Pane";
import type { Pixels } from "./pixels";
import type { RulerLine } from "./Ruler";
import { useDrawing } from "./results";
import { scalesOf } from "./ruler";
import type { Settings, SettingsEvent } from "./settings";
import Wiper from "./Wiper";

interface Props {
  readonly caseView: CaseView;
  readonly newestImage: ImageView | null;
  /** Of this picture, or null. */
  readonly localisation: LocalisationView | null;
  readonly pixels: Pixels;
  readonly settings: Settings;
  readonly dispatch: Dispatch<SettingsEvent>;
}

/** The picture, one before it where they are compared, and its holes. */
export default function Panes({ caseView, newestImage, localisation, pixels, settings, dispatch }: Props) {
  const { t } = useTranslation();
  const [ruler, setRuler] = useState<RulerLine | null>(null);
  const drawing = useDrawing(caseView.id, localisation);
  const compares = settings.compare !== "off";
  const before = useBefore(caseView.id, pixels.image, settings.before, compares, (image) =>
    t("image.before.label", { age: ageText(image.age_s) }),
  );
  const shared = {
    settings,
    dispatch,
    ruler: settings.drag === "ruler" ? ruler : null,
    onRuler: setRuler,
    scales: scalesOf(drawing, newestImage?.header?.nominal_pixel_mm ?? null),
  };
  const shown = { pixels, drawing, label: t("image.newest") };
  const isBeside = settings.compare === "beside" && before.shown !== null;
  const isWiped = settings.compare === "wiper" && before.shown !== null;
  return (
    <>
      <div className="panes">
        {isBeside && before.shown && <Pane shown={before.shown} isLabelled {...shared} />}
        <div className="pane">
          <Pane shown={shown} before={isWiped ? before.shown : null} isLabelled={compares} {...shared} />
          {isWiped && <Wiper share={settings.wiper} dispatch={dispatch} />}
        </div>
        {settings.showsHoles && !compares && localisation && drawing && (
          <Magnifiers
            pixels={pixels}
            grey={settings.grey}
            view={settings.view}
            drawing={drawing}
            localisation={localisation}
          />
        )}
      </div>
      {compares && (
        <BeforeChoice images={before.choice} chosen={before.image?.id ?? null} dispatch={dispatch} />
      )}
    </>
  );
}
