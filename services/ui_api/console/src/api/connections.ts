// A browser opens six connections to one machine, and with all of them taken a stop would wait for its turn. One is for
// the stream of events, one for the stop, and one for the lease that keeps a motion going; all else shares three.

export const SHARED_CONNECTIONS = 3;
const WITHOUT_A_BODY: ReadonlySet<number> = new Set([204, 205, 304]);

let taken = 0;
const waiting: (() => void)[] = [];

/**
 * Send when one of the shared connections is free. It is free again once the whole answer is here.
 *
 * `goesFirst`: before all that wait already, as the robot's state, by which the page knows whether it is live.
 */
export async function onSharedConnection(
  send: () => Promise<Response>,
  goesFirst = false,
): Promise<Response> {
  if (taken < SHARED_CONNECTIONS) taken++;
  else await new Promise<void>((turn) => (goesFirst ? waiting.unshift(turn) : waiting.push(turn)));
  try {
    return await wholeAnswer(await send());
  } finally {
    const next = waiting.shift();
    if (next === undefined) taken--;
    else next(); // takes over the place
  }
}

async function wholeAnswer(answer: Response): Promise<Response> {
  const body = await answer.arrayBuffer();
  const { status, statusText, headers } = answer;
  return new Response(WITHOUT_A_BODY.has(status) ? null : body, { status, statusText, headers });
}
