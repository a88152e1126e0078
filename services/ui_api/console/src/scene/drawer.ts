// The page's side of the thread that draws the scene.
import type { Drawn, NoPicture, Told } from "./drawing";

/** A canvas that another thread draws on. */
export class Drawer {
  readonly canvas = document.createElement("canvas");
  private readonly worker = new Worker(new URL("./scene.worker.tsx", import.meta.url), { type: "module" });

  constructor(place: HTMLElement, onNone: (why: NoPicture) => void) {
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    place.append(this.canvas);
    this.worker.onmessage = ({ data }: MessageEvent<NoPicture>) => onNone(data);
    this.worker.onerror = () => onNone("lost");
    const canvas = this.canvas.transferControlToOffscreen();
    this.post({ canvas }, [canvas]);
  }

  tell(changed: Partial<Drawn>): void {
    this.post({ changed });
  }

  end(): void {
    this.worker.terminate();
    this.canvas.remove();
  }

  private post(told: Told, transferred: Transferable[] = []): void {
    this.worker.postMessage(told, transferred);
  }
}
