// Decodes pictures beside the page, so that its own thread is free for the stop and for fingers.
import { type Answer, type Asked, type Decoded, greysOf } from "./decoding";

/** What this file needs of a worker's global object. */
interface Beside {
  onmessage: ((event: MessageEvent<Asked>) => void) | null;
  postMessage(answer: Answer, transferred: Transferable[]): void;
}

const beside = globalThis as unknown as Beside;
let scratch: OffscreenCanvas | null = null;

beside.onmessage = ({ data }) => {
  decoded(data).then(
    (found) => beside.postMessage({ number: data.number, decoded: found, why: "" }, [found.values.buffer]),
    (error: unknown) => beside.postMessage({ number: data.number, decoded: null, why: String(error) }, []),
  );
};

async function decoded({ blob, isReversed }: Asked): Promise<Decoded> {
  const bitmap = await createImageBitmap(blob);
  const { width, height } = bitmap;
  if (scratch?.width !== width || scratch.height !== height) scratch = new OffscreenCanvas(width, height);
  const context = scratch.getContext("2d", { willReadFrequently: true });
  if (context === null) throw new Error("this browser draws nothing on a canvas");
  context.setTransform(isReversed ? -1 : 1, 0, 0, 1, isReversed ? width : 0, 0);
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  return { width, height, values: greysOf(context.getImageData(0, 0, width, height).data) };
}
