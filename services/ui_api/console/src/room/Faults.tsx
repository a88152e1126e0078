import { useState } from "react";
import { useTranslation } from "react-i18next";
import { type RoomFaults, room } from "../api/virtualRoom";
import { Hand } from "./VirtualRoom";

const OF_THE_ROOM: Readonly<Record<string, Record<string, unknown>>> = {
  low_dose: { kind: "low_dose" },
  motion_blur: { kind: "motion_blur" },
  saturation: { kind: "saturation" },
  remove_nail: { kind: "remove_nail" },
  remove_guide: { kind: "remove_guide" },
  ring_shift: { kind: "ring_shift" },
  mount_shift: { kind: "mount_shift", shift_mm: [2, 0, 0] },
};
const OF_THE_CONTROLLER = [
  "emergency_stop",
  "silence",
  "leg_stall",
  "limit_switch",
  "encoder_jump",
  "servo_error",
  "brake_slips",
  "power_cycle",
  "slow_reply",
  "garbage_reply",
] as const;

/** Switch faults on and off. */
export default function Faults({ faults }: { readonly faults: RoomFaults }) {
  const { t } = useTranslation();
  const [chosen, setChosen] = useState("emergency_stop");
  const fault = OF_THE_ROOM[chosen] ?? { kind: "controller", name: chosen };
  return (
    <div className="room-part">
      <h3>{t("room.faults")}</h3>
      <label>
        {t("room.fault")}
        <select value={chosen} onChange={(event) => setChosen(event.target.value)}>
          {[...OF_THE_CONTROLLER, ...Object.keys(OF_THE_ROOM)].map((name) => (
            <option key={name} value={name}>
              {t(`fault.${name}`)}
            </option>
          ))}
        </select>
      </label>
      <Hand label={t("room.inject")} run={() => room.inject(fault)} />
      <Hand label={t("room.clear")} run={room.clearFaults} />
      <p>
        {onNow(faults)
          .map((name) => t(`fault.${name}`))
          .join(", ") || t("room.no_faults")}
      </p>
    </div>
  );
}

/** Names of the faults that are switched on. */
export function onNow(faults: RoomFaults): readonly string[] {
  const room: readonly (readonly [string, boolean])[] = [
    ["low_dose", faults.dose_factor < 1],
    ["motion_blur", faults.motion_blur_px > 0],
    ["saturation", faults.overexposure > 1],
    ["remove_nail", !faults.nail_present],
    ["remove_guide", !faults.guide_present],
    ["ring_shift", faults.ring_shift_mm !== 0],
    ["mount_shift", faults.mount_shift_mm.some((mm) => mm !== 0)],
  ];
  return [...room.filter(([, isOn]) => isOn).map(([name]) => name), ...faults.controller];
}
