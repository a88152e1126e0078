import { type Dispatch, type KeyboardEvent, type PointerEvent, useRef } from "react";
import { useTranslation } from "react-i18next";
import type { SettingsEvent } from "./settings";

interface Props {
  readonly share: number;
  readonly dispatch: Dispatch<SettingsEvent>;
}

const KEY_STEP = 0.05;
const KEYS: Readonly<Record<string, number>> = { ArrowLeft: -KEY_STEP, ArrowRight: KEY_STEP };

/** The line between before and after. */
export default function Wiper({ share, dispatch }: Props) {
  const { t } = useTranslation();
  const handle = useRef<HTMLDivElement>(null);

  function onMove(event: PointerEvent<HTMLDivElement>) {
    const place = handle.current?.parentElement?.getBoundingClientRect();
    if (event.buttons === 0 || place === undefined) return;
    dispatch({ kind: "wiper", share: (event.clientX - place.left) / place.width });
  }

  function onKey(event: KeyboardEvent) {
    const step = KEYS[event.key];
    if (step === undefined) return;
    event.preventDefault();
    dispatch({ kind: "wiper", share: share + step });
  }

  return (
    <div
      ref={handle}
      className="wiper"
      role="slider"
      tabIndex={0}
      aria-label={t("image.tools.compare_wiper")}
      aria-valuemin={0}
      aria-valuemax={100}
      aria-valuenow={Math.round(100 * share)}
      style={{ insetInlineStart: `${100 * share}%` }}
      onPointerDown={(event) => event.currentTarget.setPointerCapture(event.pointerId)}
      onPointerMove={onMove}
      onKeyDown={onKey}
    />
  );
}
