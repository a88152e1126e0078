import type { Dispatch, ReactNode } from "react";
import { useTranslation } from "react-i18next";
import type { DragMode, Settings, SettingsEvent } from "./settings";

interface Props {
  readonly settings: Settings;
  readonly dispatch: Dispatch<SettingsEvent>;
  readonly onWhole: () => void;
  /** The picture can be shown without distortion. */
  readonly canCorrect: boolean;
  readonly canCompare: boolean;
}

const STEP = 1.5;
const DRAGS: readonly DragMode[] = ["move", "grey", "ruler"];

/** Every tool is a word on a target for a gloved finger. */
export default function Toolbar({ settings, dispatch, onWhole, canCorrect, canCompare }: Props) {
  const { t } = useTranslation();
  return (
    <div className="tools" role="toolbar" aria-label={t("image.tools.title")}>
      <fieldset className="drags">
        <legend className="unseen">{t("image.tools.drag")}</legend>
        {DRAGS.map((mode) => (
          <Tool key={mode} isOn={settings.drag === mode} onPress={() => dispatch({ kind: "drag", mode })}>
            {t(`image.tools.${mode}`)}
          </Tool>
        ))}
      </fieldset>
      <Tool onPress={() => dispatch({ kind: "zoom", factor: STEP })} label={t("image.tools.nearer")}>
        <span className="sign">+</span>
      </Tool>
      <Tool onPress={() => dispatch({ kind: "zoom", factor: 1 / STEP })} label={t("image.tools.farther")}>
        <span className="sign">−</span>
      </Tool>
      <Tool
        onPress={() => {
          onWhole();
          dispatch({ kind: "grey_reset" });
        }}
      >
        {t("image.tools.whole")}
      </Tool>
      <Tool onPress={() => dispatch({ kind: "turn" })}>{t("image.tools.turn")}</Tool>
      <Tool isOn={settings.view.mirrored} onPress={() => dispatch({ kind: "mirror" })}>
        {t("image.tools.mirror")}
      </Tool>
      <Tool isOn={settings.grey.isInverted} onPress={() => dispatch({ kind: "invert" })}>
        {t("image.tools.invert")}
      </Tool>
      <Tool isOn={settings.isCorrected} isOff={!canCorrect} onPress={() => dispatch({ kind: "corrected" })}>
        {t("image.tools.corrected")}
      </Tool>
      <Tool isOn={settings.showsOverlay} onPress={() => dispatch({ kind: "overlay" })}>
        {t("image.tools.overlay")}
      </Tool>
      <Tool isOn={settings.showsHoles} onPress={() => dispatch({ kind: "holes" })}>
        {t("image.tools.holes")}
      </Tool>
      <Tool
        isOn={settings.compare !== "off"}
        isOff={!canCompare}
        onPress={() => dispatch({ kind: "compare" })}
      >
        {t(`image.tools.compare_${settings.compare}`)}
      </Tool>
    </div>
  );
}

interface ToolProps {
  readonly onPress: () => void;
  readonly children: ReactNode;
  readonly isOn?: boolean;
  readonly isOff?: boolean;
  readonly label?: string;
}

function Tool({ onPress, children, isOn, isOff = false, label }: ToolProps) {
  return (
    <button type="button" aria-pressed={isOn} aria-label={label} disabled={isOff} onClick={onPress}>
      {children}
    </button>
  );
}
