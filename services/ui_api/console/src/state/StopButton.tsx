import { useEffect } from "react";
import { useTranslation } from "react-i18next";
import type { StopState } from "./stop";

// A foot pedal that is wired as a keyboard sends one of these.
const STOP_KEYS: ReadonlySet<string> = new Set(["Escape", "Pause", "F12"]);

/** Always in the same place, over everything; also by key and by a pedal that sends one. */
export default function StopButton({ stop }: { readonly stop: readonly [StopState, () => void] }) {
  const { t } = useTranslation();
  const [state, press] = stop;
  useEffect(() => {
    const onKey = (event: KeyboardEvent) => {
      if (!STOP_KEYS.has(event.key) || event.repeat) return;
      event.preventDefault();
      press();
    };
    window.addEventListener("keydown", onKey, { capture: true });
    return () => window.removeEventListener("keydown", onKey, { capture: true });
  }, [press]);
  return (
    <div className="stop">
      <button
        type="button"
        className="stop-button"
        // Pressing is enough: nobody must lift his finger for it.
        onPointerDown={press}
        onClick={(event) => event.detail === 0 && press()}
      >
        {t("stop.stop")}
      </button>
      <p className={`stop-state ${state.phase}`} role="status" aria-live="assertive">
        {state.phase === "idle" ? t("stop.keys") : t(`stop.${state.phase}`)}
        {state.detail && <small>{state.detail}</small>}
      </p>
    </div>
  );
}
