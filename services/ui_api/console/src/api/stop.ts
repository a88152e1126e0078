// The stop goes past everything else: no renewal, no queue of queries, no retry that waits.
import { ApiError, problemOf, type Schemas } from "./client";

export type StopAnswer = Schemas["StopView"];
const ANSWER_WITHIN_MS = 2_000;

/** Stop the robot. Throws `ApiError` when it was not confirmed or no answer came. */
export async function stopRobot(): Promise<StopAnswer> {
  let response: Response;
  try {
    response = await fetch("/api/v1/robot/stop", {
      method: "POST",
      credentials: "same-origin",
      priority: "high",
      keepalive: true,
      signal: AbortSignal.timeout(ANSWER_WITHIN_MS),
    });
  } catch (error) {
    throw new ApiError(0, "no_answer", error instanceof Error ? error.message : String(error));
  }
  const body: unknown = await response.json();
  if (!response.ok) throw problemOf(body, response.status);
  return body as StopAnswer;
}
