// A browser opens six connections to one machine, for all of its tabs together, and with all of them taken a stop would
// wait for its turn. One is for the stream of events, one for the stop, one for the lease that keeps a motion going and
// one for the robot's state, by which the page knows whether it is live; all else shares two.
import { firstFree, type Locks, locks } from "./tabs";

const SHARED = ["distalock connection 1", "distalock connection 2"] as const;
const LANES = {
  state: ["distalock connection of the robot's state"],
  usual: SHARED,
  /** For what takes seconds or comes in crowds: the other of the two stays free for what does not. */
  long: [SHARED[0]],
} as const;
export type Lane = keyof typeof LANES;

// Longer than the gateway takes for anything but plans and verifications, which registration computes.
const ANSWER_WITHIN_MS = 60_000;

const WITHOUT_A_BODY: ReadonlySet<number> = new Set([204, 205, 304]);
const NEVER = new AbortController().signal;

/** A signal that also ends what got no answer for too long. */
export function withinLimit(leaving: AbortSignal): AbortSignal {
  return AbortSignal.any([leaving, AbortSignal.timeout(ANSWER_WITHIN_MS)]);
}

/**
 * Send when a connection of that lane is free. It is free again once the whole answer is here, or when none came
 * within the limit: a network that swallows an answer would keep it for all tabs.
 */
export async function onConnection(
  lane: Lane,
  send: (signal: AbortSignal) => Promise<Response>,
  leaving: AbortSignal = NEVER,
  of: Locks = locks,
): Promise<Response> {
  const signal = withinLimit(leaving);
  const giveBack = await firstFree(LANES[lane], signal, of);
  try {
    return await wholeAnswer(await send(signal));
  } finally {
    giveBack();
  }
}

async function wholeAnswer(answer: Response): Promise<Response> {
  const body = await answer.arrayBuffer();
  const { status, statusText, headers } = answer;
  return new Response(WITHOUT_A_BODY.has(status) ? null : body, { status, statusText, headers });
}
