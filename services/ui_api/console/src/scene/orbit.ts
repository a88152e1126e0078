// The camera: put where a view says, turned, shifted and brought nearer by hands from there.
import { PerspectiveCamera } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { CameraPlace } from "./drawing";
import { fieldOfViewDeg, type View } from "./views";

const NEAR_SHARE = 0.02;
const FAR_SHARE = 6;

export class Orbit {
  readonly camera = new PerspectiveCamera();
  private readonly controls: OrbitControls;

  /** `onMoved`: whenever the camera stands elsewhere; `onTurned`: when a hand begins to move it. */
  constructor(element: HTMLElement, onMoved: () => void, onTurned: () => void) {
    this.controls = new OrbitControls(this.camera, element);
    this.controls.enableDamping = false;
    this.controls.addEventListener("change", onMoved);
    this.controls.addEventListener("start", onTurned);
    this.controls.listenToKeyEvents(element);
  }

  put(view: View, aspect: number): void {
    const { camera, controls } = this;
    const distance_mm = view.eye_mm.distanceTo(view.target_mm);
    camera.up.copy(view.up);
    camera.position.copy(view.eye_mm);
    camera.near = distance_mm * NEAR_SHARE;
    camera.far = distance_mm * FAR_SHARE;
    camera.aspect = aspect;
    camera.fov = fieldOfViewDeg(view, aspect);
    camera.lookAt(view.target_mm);
    camera.updateProjectionMatrix();
    // Controls keep the direction that was up when they were made.
    controls.target.copy(view.target_mm);
    controls.update();
  }

  place(): CameraPlace {
    const { position, quaternion, fov, near, far } = this.camera;
    return {
      position_mm: [position.x, position.y, position.z],
      turn_xyzw: [quaternion.x, quaternion.y, quaternion.z, quaternion.w],
      opening_deg: fov,
      near_mm: near,
      far_mm: far,
    };
  }

  end(): void {
    this.controls.dispose();
  }
}
