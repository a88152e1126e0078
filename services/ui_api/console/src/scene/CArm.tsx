import { useMemo } from "react";
import { CatmullRomCurve3, ConeGeometry, TubeGeometry, Vector3 } from "three";
import { along } from "./lines";
import { LOOK, SHAPE } from "./looks";
import type { RingPart } from "./parts";
import { Balls, Placed, Rod } from "./pieces";
import type { Seen } from "./sceneModel";
import { Transform } from "./transform";

interface Props {
  readonly seen: Seen;
  readonly ring: RingPart;
  /** Where the arc goes round the patient: under the table. */
  readonly down: Vector3;
  readonly usual_source_to_detector_mm: number;
}

// The detector's face is just behind the ring that is fixed to it.
const BEHIND_RING_MM = 25;
const USUAL_RADIUS_MM = 118;
const RAY_MM = 0.5;

/** Tube, detector with ring, the and the cone of rays between them, in the image's moment. */
export default function CArm({ seen, ring, down, usual_source_to_detector_mm }: Props) {
  const { base_from_camera, camera_from_ring } = seen;
  if (base_from_camera === null) return null;
  const radius_mm = Math.max(...ring.plates.map((plate) => plate.radius_mm), USUAL_RADIUS_MM);
  const usual = Transform.ofRotation<"camera", "ring">(LEVEL, [
    0,
    0,
    usual_source_to_detector_mm - BEHIND_RING_MM,
  ]);
  const ringAt = camera_from_ring ?? usual;
  const face_mm = ringAt.point([0, 0, BEHIND_RING_MM]);
  const downInCamera = base_from_camera.inverse().direction(down);
  return (
    <Placed at={base_from_camera.matrix}>
      <Beam face_mm={face_mm} radius_mm={radius_mm} />
      <Rod
        from_mm={new Vector3(0, 0, -150)}
        to_mm={new Vector3(0, 0, 20)}
        radius_mm={85}
        look={LOOK.housing}
      />
      <Rod
        from_mm={face_mm}
        to_mm={face_mm.clone().add(new Vector3(0, 0, 130))}
        radius_mm={radius_mm + 25}
        look={LOOK.housing}
      />
      <Arc face_mm={face_mm} down={downInCamera} />
      <Placed at={ringAt.matrix}>
        {ring.plates.map((plate) => (
          <Rod
            key={plate.z_mm}
            from_mm={new Vector3(0, 0, plate.z_mm)}
            to_mm={new Vector3(0, 0, plate.z_mm + plate.thickness_mm)}
            radius_mm={plate.radius_mm}
            look={LOOK.window}
          />
        ))}
        <Balls balls={ring.balls} shape={SHAPE.coarseBall} />
      </Placed>
    </Placed>
  );
}

const LEVEL = [
  [1, 0, 0],
  [0, 1, 0],
  [0, 0, 1],
] as const;

function Beam({ face_mm, radius_mm }: { readonly face_mm: Vector3; readonly radius_mm: number }) {
  const length_mm = face_mm.z;
  const shape = useMemo(() => {
    const cone = new ConeGeometry(radius_mm, length_mm, 40, 1, true);
    cone.rotateX(-Math.PI / 2);
    cone.translate(0, 0, length_mm / 2);
    return cone;
  }, [radius_mm, length_mm]);
  return <mesh geometry={shape} material={LOOK.beam} renderOrder={5} />;
}

function Arc({ face_mm, down }: { readonly face_mm: Vector3; readonly down: Vector3 }) {
  const [depth, dx, dy] = [face_mm.z + 130, down.x, down.y];
  const shape = useMemo(() => {
    const across = Math.hypot(dx, dy) || 1;
    const points = Array.from({ length: 13 }, (_, index) => {
      const angle = (Math.PI * index) / 12;
      const out = (depth * 0.62 * Math.sin(angle)) / across;
      return new Vector3(dx * out, dy * out, -130 + ((depth + 130) * (1 - Math.cos(angle))) / 2);
    });
    return new TubeGeometry(new CatmullRomCurve3(points), 40, 34, 8);
  }, [depth, dx, dy]);
  return <mesh geometry={shape} material={LOOK.housing} />;
}

/** From the focal spot through the middle of each hole: the angle to the hole's axis is its tilt. */
export function Rays({ seen }: { readonly seen: Seen }) {
  const focal_spot_mm = seen.base_from_camera?.point([0, 0, 0]);
  if (focal_spot_mm === undefined) return null;
  return seen.holes.map((hole) => {
    const middle = hole.axis.point_mm.clone().lerp(hole.exit_mm, 0.5);
    const direction = middle.clone().sub(focal_spot_mm).normalize();
    return (
      <Rod
        key={hole.id}
        from_mm={focal_spot_mm}
        to_mm={along({ point_mm: middle, direction }, 60)}
        radius_mm={RAY_MM}
        look={LOOK.ray}
      />
    );
  });
}
