import { useTranslation } from "react-i18next";
import type { Ghost } from "./useGhost";

/** Play the planned motion, hold it anywhere, put it away. */
export default function GhostControls({ ghost, faster }: { readonly ghost: Ghost; readonly faster: number }) {
  const { t } = useTranslation();
  const isShown = ghost.share !== null;
  const percent = Math.round((ghost.share ?? 0) * 100);
  return (
    <div className="scene-motion">
      {ghost.isPlaying ? (
        <button type="button" onClick={ghost.pause}>
          {t("scene.pause")}
        </button>
      ) : (
        <button type="button" onClick={ghost.play}>
          {t("scene.play")}
        </button>
      )}
      {isShown && (
        <>
          <input
            type="range"
            min={0}
            max={100}
            value={percent}
            aria-label={t("scene.share")}
            onChange={(event) => ghost.show(Number(event.target.value) / 100)}
          />
          <output>{percent} %</output>
          <button type="button" onClick={ghost.hide}>
            {t("scene.hide")}
          </button>
          {ghost.isPlaying && (
            <small>{t(faster >= 1 ? "scene.faster" : "scene.slower", { times: times(faster) })}</small>
          )}
        </>
      )}
    </div>
  );
}

function times(faster: number): string {
  return (faster >= 1 ? faster : 1 / faster).toFixed(1);
}
