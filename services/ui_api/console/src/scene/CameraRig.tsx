import { useThree } from "@react-three/fiber";
import { useEffect, useLayoutEffect, useRef } from "react";
import { PerspectiveCamera, type Vector3 } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { fieldOfViewDeg, type View } from "./views";

interface Props {
  readonly view: View;
  /** Changes when the same view is asked for again after the hand has turned it. */
  readonly asked: number;
  readonly onTurned: () => void;
}

const NEAR_SHARE = 0.02;
const FAR_SHARE = 6;

/** Puts the camera where a view says, and lets hands turn, shift and zoom from there. */
export default function CameraRig({ view, asked, onTurned }: Props) {
  const { camera, gl, invalidate, size } = useThree();
  const controls = useRef<OrbitControls | null>(null);
  const turned = useRef(onTurned);
  turned.current = onTurned;

  useEffect(() => {
    const made = new OrbitControls(camera, gl.domElement);
    made.enableDamping = false;
    made.addEventListener("change", () => invalidate());
    made.addEventListener("start", () => turned.current());
    made.listenToKeyEvents(gl.domElement);
    controls.current = made;
    return () => made.dispose();
  }, [camera, gl, invalidate]);

  const aspect = size.width / Math.max(size.height, 1);
  const key = `${asked} ${keyOf(view.eye_mm)} ${keyOf(view.target_mm)} ${keyOf(view.up)}`;
  // biome-ignore lint/correctness/useExhaustiveDependencies: `key` is what of the view counts, rounded.
  useLayoutEffect(() => {
    if (!(camera instanceof PerspectiveCamera)) return;
    const distance_mm = view.eye_mm.distanceTo(view.target_mm);
    camera.up.copy(view.up);
    camera.position.copy(view.eye_mm);
    camera.near = distance_mm * NEAR_SHARE;
    camera.far = distance_mm * FAR_SHARE;
    camera.fov = fieldOfViewDeg(view, aspect);
    camera.lookAt(view.target_mm);
    camera.updateProjectionMatrix();
    const made = controls.current;
    if (made) {
      // Controls keep the direction that was up when they were made.
      made.target.copy(view.target_mm);
      made.update();
    }
    invalidate();
  }, [key, aspect]);
  return null;
}

/** Places that differ by less than half a millimetre are the same: a camera that creeps after the robot disturbs. */
function keyOf(v: Vector3): string {
  return v
    .toArray()
    .map((value) => value.toFixed(value > 1 || value < -1 ? 0 : 2))
    .join(",");
}
