// From where the scene is looked at: pure.
import { MathUtils, Vector3 } from "three";
import type { SceneModel } from "./sceneModel";
import { Transform } from "./transform";

export type ViewId = "surgeon" | "above" | "room" | `along:${string}`;

/** Whether a view looks along a hole. */
export function isAlong(id: ViewId): boolean {
  return id.startsWith("along:");
}

export interface View {
  readonly eye_mm: Vector3;
  readonly target_mm: Vector3;
  readonly up: Vector3;
  /** Height of what is seen at the target. */
  readonly field_mm: number;
}

/** Directions of the patient on the table, in the base's frame. */
export interface Directions {
  readonly distal: Vector3;
  /** In the direction of drilling: away from the surgeon. */
  readonly away: Vector3;
  readonly up: Vector3;
}

/**
 * The patient lies on the back, and the surgeon stands at the leg and drills a femur from lateral, a tibia from
 * medial: so the side tells which of the nail's directions is up.
 */
export function directionsOf(model: Pick<SceneModel, "side" | "bone" | "seen">): Directions {
  // Before an image has shown the nail: as a mount holds the base (`hexapod_mount.py`).
  const base_from_nail =
    model.seen?.base_from_nail ?? Transform.ofRotation<"base", "nail">(USUAL_ROTATION, [0, 0, 0]);
  const sign = (model.side === "left") === (model.bone === "femur") ? 1 : -1;
  return {
    distal: base_from_nail.direction([1, 0, 0]),
    away: base_from_nail.direction([0, 0, 1]),
    up: base_from_nail.direction([0, sign, 0]),
  };
}

const USUAL_ROTATION = [
  [1, 0, 0],
  [0, -1, 0],
  [0, 0, -1],
] as const;
const FAR_MM = { surgeon: 420, above: 480, room: 2600, along: 330 };
const FIELD_MM = { surgeon: 185, above: 215, room: 1250, along: 26 };

export function viewOf(model: SceneModel, id: ViewId): View {
  const { distal, away, up } = directionsOf(model);
  const middle = middleOf(model);
  if (id === "above")
    return {
      eye_mm: middle.clone().addScaledVector(up, FAR_MM.above),
      target_mm: middle,
      up: away,
      field_mm: FIELD_MM.above,
    };
  if (id === "room") return roomView(model, middle);
  const hole = model.seen?.holes.find((one) => id === `along:${one.id}`);
  if (hole) {
    const target_mm = hole.axis.point_mm;
    const eye_mm = target_mm.clone().addScaledVector(hole.axis.direction, -FAR_MM.along);
    return { eye_mm, target_mm, up, field_mm: FIELD_MM.along };
  }
  // Over the surgeon's shoulder: a little from above and from the foot.
  const towards = away
    .clone()
    .multiplyScalar(-1)
    .addScaledVector(up, 0.55)
    .addScaledVector(distal, 0.45)
    .normalize();
  return {
    eye_mm: middle.clone().addScaledVector(towards, FAR_MM.surgeon),
    target_mm: middle,
    up,
    field_mm: FIELD_MM.surgeon,
  };
}

function roomView(model: SceneModel, middle: Vector3): View {
  const { distal, away, up } = directionsOf(model);
  const towards = away
    .clone()
    .multiplyScalar(-0.45)
    .addScaledVector(up, 0.5)
    .addScaledVector(distal, 1)
    .normalize();
  const target_mm = model.seen?.base_from_camera?.point([0, 0, 520]) ?? middle;
  return {
    eye_mm: target_mm.clone().addScaledVector(towards, FAR_MM.room),
    target_mm,
    up,
    field_mm: FIELD_MM.room,
  };
}

/** Between the guide and the nail. */
function middleOf(model: SceneModel): Vector3 {
  const guide = model.now?.base_from_guide.point([-20, 0, 0]);
  const nail = model.seen?.base_from_nail.point([-20, 0, 0]);
  if (guide && nail) return guide.add(nail).multiplyScalar(0.5);
  return guide ?? nail ?? new Vector3(20, 0, model.parts.hexapod.zero_height_mm / 2);
}

/** Angle that the camera must open to see the whole field, also in a place that is narrower than it is high. */
export function fieldOfViewDeg(view: View, aspect: number): number {
  const height_mm = view.field_mm / Math.min(aspect, 1);
  const half = height_mm / 2 / view.eye_mm.distanceTo(view.target_mm);
  return 2 * MathUtils.radToDeg(Math.atan(half));
}
