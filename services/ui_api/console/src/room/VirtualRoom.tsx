import { useMutation, useQueryClient } from "@tanstack/react-query";
import { type ReactNode, useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import type { AlignmentView } from "../api/types";
import { type RoomState, room, useRoomState, useTruth } from "../api/virtualRoom";
import ProblemNote from "../state/ProblemNote";
import Faults from "./Faults";

interface Props {
  readonly holeIds: readonly string[];
  readonly advice: AlignmentView | null;
  readonly onHide: () => void;
}

const RUN_IMAGES = 50;

/** Hands in the virtual operating room: no part of the product, and set apart so that nobody takes it for one. */
export default function VirtualRoom({ holeIds, advice, onHide }: Props) {
  const { t } = useTranslation();
  const state = useRoomState(true).data;
  return (
    <section className="virtual-room" aria-label={t("room.title")}>
      <h2>
        {t("room.title")} <small>{t("room.not_the_product")}</small>
        <button type="button" aria-expanded={true} onClick={onHide}>
          {t("room.hide")}
        </button>
      </h2>
      <div className="room-parts">
        <Part title={t("room.pedal")}>
          <Hand label={t("room.shoot")} run={room.shoot} isMain />
          <Hand label={t("room.fluoroscopy")} run={() => room.fluoroscopy(RUN_IMAGES)} />
        </Part>
        {state && <CArm state={state} advice={advice} />}
        <Part title={t("room.tools")}>
          <Hand label={t("room.wires_in")} run={room.insertWires} />
          <Hand label={t("room.wires_out")} run={room.removeWires} />
          {holeIds.map((hole) => (
            <Hand key={hole} label={t("room.drill", { hole })} run={() => room.drill(hole)} />
          ))}
          <Hand label={t("room.new_bone")} run={room.newBone} />
          {state?.drills.map((drill) => (
            <p key={drill.hole_id} className={drill.passed ? "good" : "attention"}>
              {t(drill.passed ? "room.passed" : "room.struck", {
                hole: drill.hole_id,
                what: drill.struck ?? "",
                mm: drill.entry_offset_mm.toFixed(2),
              })}
            </p>
          ))}
        </Part>
        {state && <Faults faults={state.faults} />}
        <Truth />
      </div>
    </section>
  );
}

function Part({ title, children }: { readonly title: string; readonly children: ReactNode }) {
  return (
    <div className="room-part">
      <h3>{title}</h3>
      {children}
    </div>
  );
}

interface HandProps {
  readonly label: string;
  readonly run: () => Promise<unknown>;
  readonly isMain?: boolean;
}

/** One thing that hands do. */
export function Hand({ label, run, isMain = false }: HandProps) {
  const client = useQueryClient();
  const doing = useMutation<unknown, Error, void>({
    mutationFn: run,
    onSettled: () => void client.invalidateQueries({ queryKey: ["virtual room"] }),
  });
  return (
    <div>
      <button
        type="button"
        className={isMain ? "hand main-hand" : "hand"}
        disabled={doing.isPending}
        onClick={() => doing.mutate()}
      >
        {label}
      </button>
      <ProblemNote error={doing.error} />
    </div>
  );
}

const REACH_DEG = 45;

function CArm({ state, advice }: { readonly state: RoomState; readonly advice: AlignmentView | null }) {
  const { t } = useTranslation();
  const { orbital_deg, angular_deg } = state.cArm;
  const turn = advice?.c_arm_correction_deg;
  return (
    <Part title={t("room.c_arm")}>
      <Angle label={t("room.orbital")} value={orbital_deg} onSet={(deg) => room.turnTo(deg, angular_deg)} />
      <Angle label={t("room.angular")} value={angular_deg} onSet={(deg) => room.turnTo(orbital_deg, deg)} />
      {turn && (
        <Hand label={t("room.as_advised")} run={() => room.turnBy(turn.about_image_x, turn.about_image_y)} />
      )}
    </Part>
  );
}

interface AngleProps {
  readonly label: string;
  readonly value: number;
  readonly onSet: (deg: number) => Promise<unknown>;
}

function Angle({ label, value, onSet }: AngleProps) {
  const client = useQueryClient();
  const [shown, setShown] = useState(value);
  useEffect(() => setShown(value), [value]);
  const turning = useMutation<unknown, Error, number>({
    mutationFn: onSet,
    onSettled: () => void client.invalidateQueries({ queryKey: ["virtual room"] }),
  });
  const send = () => shown !== value && turning.mutate(shown);
  const middle = Math.round(value / 90) * 90;
  return (
    <label>
      {label}: {shown.toFixed(1)}°
      <input
        type="range"
        min={middle - REACH_DEG}
        max={middle + REACH_DEG}
        step={0.5}
        value={shown}
        onChange={(event) => setShown(Number(event.target.value))}
        onPointerUp={send}
        onKeyUp={send}
      />
      <ProblemNote error={turning.error} />
    </label>
  );
}

function Truth() {
  const { t } = useTranslation();
  const [isShown, setShown] = useState(false);
  const truth = useTruth(isShown).data;
  return (
    <Part title={t("room.truth")}>
      <button type="button" aria-pressed={isShown} onClick={() => setShown(!isShown)}>
        {t(isShown ? "room.hide_truth" : "room.show_truth")}
      </button>
      {isShown &&
        truth?.map((axis) => (
          <p key={axis.hole_id}>
            {t("room.true_error", {
              hole: axis.hole_id,
              entry: axis.entry_offset_mm.toFixed(2),
              exit: axis.exit_offset_mm.toFixed(2),
              deg: axis.angle_deg.toFixed(2),
            })}
          </p>
        ))}
    </Part>
  );
}
