// Draws the scene beside the page. Where the processor draws, whoever shows a picture waits until it is drawn: on the
// page's own thread fingers and the stop would wait too.
import { createRoot, extend, type ReconcilerRoot } from "@react-three/fiber";
import { DirectionalLight, Group, HemisphereLight, InstancedMesh, Mesh, PerspectiveCamera } from "three";
import type { CameraPlace, Drawn, NoPicture, Told } from "./drawing";
import { findGraphics, type Graphics } from "./graphics";
import SceneContent from "./SceneContent";

/** What this file needs of a worker's global object. */
interface Beside {
  onmessage: ((event: MessageEvent<Told>) => void) | null;
  postMessage(said: NoPicture): void;
}

const beside = globalThis as unknown as Beside;
const FINEST_RATIO = 2;
const WANTED: readonly (keyof Drawn)[] = [
  "parts",
  "sources",
  "source_to_detector_mm",
  "ghostShare",
  "isLive",
  "view",
  "size",
  "camera",
];

extend({ DirectionalLight, Group, HemisphereLight, InstancedMesh, Mesh });

class Picture {
  private readonly camera = new PerspectiveCamera();
  private readonly root: ReconcilerRoot<OffscreenCanvas>;
  private drawn: Partial<Drawn> = {};
  private invalidate: () => void = () => undefined;

  constructor(
    canvas: OffscreenCanvas,
    private readonly graphics: Graphics,
  ) {
    canvas.addEventListener("webglcontextlost", () => beside.postMessage("lost"));
    this.root = createRoot(canvas);
  }

  change(changed: Partial<Drawn>): void {
    this.drawn = { ...this.drawn, ...changed };
    if (!isWhole(this.drawn)) return;
    if (changed.size) this.fit(this.drawn);
    if (changed.camera) aim(this.camera, changed.camera);
    if (Object.keys(changed).some((key) => key !== "camera"))
      this.invalidate = this.root.render(<SceneContent {...this.drawn} />).getState().invalidate;
    this.invalidate();
  }

  /** Drawn by the processor: one pixel of the picture a pixel of the page, and edges that are not smoothed. */
  private fit({ size }: Drawn): void {
    const isCoarse = this.graphics === "processor";
    void this.root.configure({
      frameloop: "demand",
      dpr: isCoarse ? 1 : Math.min(size.pixelRatio, FINEST_RATIO),
      size: { width: size.width, height: size.height, top: 0, left: 0 },
      gl: { antialias: !isCoarse, alpha: true, powerPreference: "high-performance" },
      camera: this.camera,
      flat: true,
    });
  }
}

function isWhole(drawn: Partial<Drawn>): drawn is Drawn {
  return WANTED.every((key) => key in drawn);
}

function aim(camera: PerspectiveCamera, { position_mm, turn_xyzw, ...place }: CameraPlace): void {
  camera.position.set(...position_mm);
  camera.quaternion.set(...turn_xyzw);
  camera.fov = place.opening_deg;
  camera.near = place.near_mm;
  camera.far = place.far_mm;
  camera.updateProjectionMatrix();
}

let picture: Picture | null = null;

beside.onmessage = ({ data }) => {
  if ("changed" in data) return picture?.change(data.changed);
  const graphics = findGraphics();
  if (graphics === "none") return beside.postMessage("missing");
  picture = new Picture(data.canvas, graphics);
};
