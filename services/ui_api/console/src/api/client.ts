// The one place that talks to the gateway. Everything else asks it through `queries.ts` and `actions.ts`.
import createClient from "openapi-fetch";
import { type Lane, onConnection, withinLimit } from "./connections";
import { withRenewal } from "./renewal";
import type { components, paths } from "./schema";

export type Schemas = components["schemas"];
export type Problem = Schemas["Problem"];

/** An answer that is a problem document (RFC 9457), or no answer at all (`status` 0). */
export class ApiError extends Error {
  constructor(
    readonly status: number,
    readonly code: string,
    readonly detail: string,
    readonly problem: Problem | null = null,
  ) {
    super(detail);
  }
}

async function sent(request: Request): Promise<Response> {
  return await withRenewal(request, (again) => {
    const send = (signal: AbortSignal) => fetch(again, { signal, credentials: "same-origin" });
    const lane = laneOf(again);
    return lane === null ? send(withinLimit(again.signal)) : onConnection(lane, send, again.signal);
  });
}

/** Null for a lease, which waits for nothing: without it the robot stops. */
function laneOf({ method, url }: Request): Lane | null {
  const { pathname } = new URL(url);
  if (method === "PUT" && pathname.endsWith("/lease")) return null;
  if (method === "GET" && pathname === "/api/v1/robot") return "state";
  return method === "POST" && /\/(plans|verifications)$/.test(pathname) ? "long" : "usual";
}

export const gateway = createClient<paths>({
  // Tests of pure parts have no address.
  baseUrl: globalThis.location?.origin ?? "http://localhost",
  fetch: sent,
});

interface Answered<T> {
  data?: T;
  error?: unknown;
  response: Response;
}

/** The content of an answer; throws `ApiError` when it is a problem or did not come. */
export async function content<T>(answer: Promise<Answered<T>>): Promise<T> {
  return (await answered(answer)).data;
}

/** The same with the response, for its headers. */
export async function answered<T>(answer: Promise<Answered<T>>): Promise<{ data: T; response: Response }> {
  let got: Answered<T>;
  try {
    got = await answer;
  } catch (error) {
    throw new ApiError(0, "no_answer", error instanceof Error ? error.message : String(error));
  }
  if (got.error !== undefined || !got.response.ok) throw problemOf(got.error, got.response.status);
  return { data: got.data as T, response: got.response };
}

export function problemOf(error: unknown, status: number): ApiError {
  const problem = typeof error === "object" && error !== null ? (error as Partial<Problem>) : {};
  const code = problem.code ?? "no_answer";
  return new ApiError(status, code, problem.detail ?? `status ${status}`, problem as Problem);
}

/** A new key for a new action. `crypto.randomUUID` is missing on pages that were not loaded by HTTPS. */
export function newKey(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}
