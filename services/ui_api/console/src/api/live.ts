// The newest frame and guidance, as `WS /live` sends them: one socket for the whole page.
import type { GuidanceView } from "./types";

export interface LiveFrame {
  readonly image: string;
  readonly sequence: number;
  readonly case_id: string | null;
  readonly age_s: number | null;
  readonly guidance: GuidanceView | null;
  /** The newest picture (JPEG); of `pictureOf`, which is `image` unless its picture is still on the way. */
  readonly picture: Blob | null;
  readonly pictureOf: string | null;
  /** When the message came, by `performance.now()`: ages count from there. */
  readonly gotAtMs: number;
}

type Message = Omit<LiveFrame, "gotAtMs" | "picture" | "pictureOf"> & { readonly picture: string | null };
const AGAIN_AFTER_MS = 500;

/** Follows `WS /live` for as long as somebody listens. */
export class LiveFeed {
  private readonly listeners = new Set<() => void>();
  private socket: WebSocket | null = null;
  private awaited: Message | null = null;
  private newest: LiveFrame | null = null;

  /** For `useSyncExternalStore`. */
  readonly subscribe = (listener: () => void): (() => void) => {
    this.listeners.add(listener);
    if (this.socket === null) this.open();
    return () => {
      this.listeners.delete(listener);
      if (this.listeners.size === 0) this.close();
    };
  };

  readonly frame = (): LiveFrame | null => this.newest;

  private open(): void {
    const address = new URL("/api/v1/live", globalThis.location.href);
    address.protocol = address.protocol.replace("http", "ws");
    const socket = new WebSocket(address);
    socket.binaryType = "blob";
    socket.onmessage = (event: MessageEvent<string | Blob>) => this.take(event.data);
    socket.onclose = () => this.onClosed(socket);
    this.socket = socket;
  }

  private close(): void {
    const socket = this.socket;
    this.socket = null;
    socket?.close();
  }

  private onClosed(socket: WebSocket): void {
    if (this.socket !== socket) return;
    this.socket = null;
    this.show(null); // nothing old is shown as live
    setTimeout(() => {
      if (this.listeners.size > 0 && this.socket === null) this.open();
    }, AGAIN_AFTER_MS);
  }

  private take(data: string | Blob): void {
    if (typeof data !== "string") {
      if (this.awaited !== null) this.show(framed(this.awaited, data, this.awaited.image));
      this.awaited = null;
      return;
    }
    const message = JSON.parse(data) as Message;
    if (message.picture === null)
      this.show(framed(message, this.newest?.picture ?? null, this.newest?.pictureOf ?? null));
    else this.awaited = message;
  }

  private show(frame: LiveFrame | null): void {
    this.newest = frame;
    for (const listener of this.listeners) listener();
  }
}

function framed(message: Message, picture: Blob | null, pictureOf: string | null): LiveFrame {
  return { ...message, picture, pictureOf, gotAtMs: performance.now() };
}

export const liveFeed = new LiveFeed();
