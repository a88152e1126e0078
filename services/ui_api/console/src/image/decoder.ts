// The page's side of the decoder.
import type { Answer, Asked, Decoded } from "./decoding";

interface Waiting {
  readonly take: (decoded: Decoded) => void;
  readonly refuse: (error: Error) => void;
}

const waiting = new Map<number, Waiting>();
let worker: Worker | null = null;
let newest = 0;

/** Grey values of a picture, decoded by a thread of its own. */
export function greyValues(blob: Blob, isReversed: boolean): Promise<Decoded> {
  worker ??= started();
  const asked: Asked = { number: ++newest, blob, isReversed };
  return new Promise((take, refuse) => {
    waiting.set(asked.number, { take, refuse });
    worker?.postMessage(asked);
  });
}

function started(): Worker {
  const made = new Worker(new URL("./decoder.worker.ts", import.meta.url), { type: "module" });
  made.onmessage = ({ data }: MessageEvent<Answer>) => {
    const whose = waiting.get(data.number);
    waiting.delete(data.number);
    if (data.decoded === null) whose?.refuse(new Error(data.why));
    else whose?.take(data.decoded);
  };
  // It could not be loaded: whoever waits must not wait for ever, and the next picture tries again.
  made.onerror = () => {
    worker = null;
    for (const whose of waiting.values()) whose.refuse(new Error("the decoder did not start"));
    waiting.clear();
  };
  return made;
}
