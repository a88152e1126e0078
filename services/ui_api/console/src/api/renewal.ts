// Access ends every 15 minutes and with the gateway's process; the session goes on. A refresh token is good once, so
// that tabs of one browser, which share it, must take turns.
import { onConnection } from "./connections";
import { locks } from "./tabs";

const REFRESH = "/api/v1/sessions/refresh";
const ME = "/api/v1/users/me";
const SIGN_IN = "/api/v1/sessions";
const RENEWABLE = new Set(["token_missing", "token_invalid", "token_expired"]);

type Send = (request: Request) => Promise<Response>;

let underWay: Promise<boolean> | null = null;

/** Send a request; where access has ended, renew the session and send it once more. */
export async function withRenewal(request: Request, send: Send): Promise<Response> {
  const copy = request.clone();
  const answer = await send(request);
  if (answer.status !== 401 || !(await isRenewable(request, answer))) return answer;
  return (await renewed()) ? await send(copy) : answer;
}

async function isRenewable(request: Request, answer: Response): Promise<boolean> {
  const path = new URL(request.url).pathname;
  if (path === SIGN_IN || path === REFRESH) return false;
  try {
    const problem = (await answer.clone().json()) as { code?: string };
    return RENEWABLE.has(problem.code ?? "");
  } catch {
    return false;
  }
}

/** Renew the session; whether there is one now. Requests that ask at the same time share one renewal. */
export function renewed(): Promise<boolean> {
  underWay ??= inTurn(renewOnce).finally(() => {
    underWay = null;
  });
  return underWay;
}

async function renewOnce(): Promise<boolean> {
  // Another tab may have renewed it while this one waited for its turn.
  const known = await onConnection("usual", (signal) => fetch(ME, { signal, credentials: "same-origin" }));
  if (known.ok) return true;
  const answer = await onConnection("usual", (signal) =>
    fetch(REFRESH, { method: "POST", signal, credentials: "same-origin" }),
  );
  return answer.ok;
}

async function inTurn(act: () => Promise<boolean>): Promise<boolean> {
  return await locks.request("distalock renewal", { signal: new AbortController().signal }, act);
}
