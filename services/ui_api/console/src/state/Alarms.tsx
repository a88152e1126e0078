import { useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import type { Alarm, Priority } from "./alarms";
import { AGAIN_AFTER_MS, sound } from "./sound";

const SHOWN = 3;

/** The alarms that hold, in words, with their priority. */
export default function Alarms({ alarms }: { readonly alarms: readonly Alarm[] }) {
  const { t } = useTranslation();
  return (
    <div className="alarms" role="alert" aria-live="assertive">
      <ul aria-label={t("alarm.title")}>
        {alarms.slice(0, SHOWN).map((alarm) => (
          <li key={`${alarm.id} ${alarm.values.part ?? ""}`} className={`alarm ${alarm.priority}`}>
            <strong>{t(`alarm.priority.${alarm.priority}`)}</strong> {t(`alarm.${alarm.id}`, alarm.values)}
          </li>
        ))}
        {alarms.length > SHOWN && (
          <li className="alarm more">{t("alarm.more", { count: alarms.length - SHOWN })}</li>
        )}
      </ul>
    </div>
  );
}

/** The switch for the alarms' sound, which is off until somebody has switched it on. */
export function AlarmSound({ alarms }: { readonly alarms: readonly Alarm[] }) {
  const { t } = useTranslation();
  const [audio, setAudio] = useState<AudioContext | null>(null);
  useSound(audio, alarms[0]?.priority ?? null);
  function toggle() {
    if (audio === null) return setAudio(new AudioContext());
    void audio.close();
    return setAudio(null);
  }
  return (
    <button type="button" className="sound" aria-pressed={audio !== null} onClick={toggle}>
      {t(audio === null ? "alarm.sound_off" : "alarm.sound_on")}
    </button>
  );
}

function useSound(audio: AudioContext | null, priority: Priority | null): void {
  useEffect(() => {
    if (audio === null || priority === null) return;
    sound(audio, priority);
    const timer = setInterval(() => sound(audio, priority), AGAIN_AFTER_MS[priority]);
    return () => clearInterval(timer);
  }, [audio, priority]);
}
