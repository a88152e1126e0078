import { useTranslation } from "react-i18next";
import { isUnderWay } from "./hold";
import type { Hold } from "./useHold";

const KEYS: ReadonlySet<string> = new Set([" ", "Enter"]);

/** Held, the robot moves; let go, it stops. By finger, mouse or key. */
export default function HoldToMove({
  hold,
  isAllowed,
}: {
  readonly hold: Hold;
  readonly isAllowed: boolean;
}) {
  const { t } = useTranslation();
  const { state, press, release } = hold;
  const isOn = isUnderWay(state);
  if (!isAllowed && state.phase === "idle") return null;
  const ended = state.phase === "ended" ? state : null;
  return (
    <div className="hold">
      {(isAllowed || isOn) && (
        <button
          type="button"
          className={`hold-button ${state.phase}`}
          onPointerDown={(event) => {
            event.currentTarget.setPointerCapture(event.pointerId);
            press();
          }}
          onPointerUp={release}
          onPointerCancel={release}
          onLostPointerCapture={release}
          onKeyDown={(event) => {
            if (!KEYS.has(event.key)) return;
            event.preventDefault();
            if (!event.repeat) press();
          }}
          onKeyUp={(event) => KEYS.has(event.key) && release()}
          onBlur={release}
          onContextMenu={(event) => event.preventDefault()}
        >
          {t(`hold.${state.phase === "ended" ? "idle" : state.phase}`)}
        </button>
      )}
      <p role="status" aria-live="assertive" className={ended ? `hold-end ${ended.status}` : "hold-end"}>
        {ended ? t(`hold.ended.${ended.status}`, { detail: ended.detail }) : t("hold.how")}
      </p>
    </div>
  );
}
