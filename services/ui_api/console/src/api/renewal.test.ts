import { afterEach, describe, expect, it, vi } from "vitest";
import { withRenewal } from "./renewal";

function answer(status: number, code = ""): Response {
  return new Response(JSON.stringify({ code }), { status });
}

const PLAN = "http://localhost/api/v1/cases/c/plans";

describe("withRenewal", () => {
  afterEach(() => vi.unstubAllGlobals());

  it("sends a request again, with its body, when access had ended and the session goes on", async () => {
    const asked: string[] = [];
    vi.stubGlobal("fetch", (path: string) => {
      asked.push(path);
      return Promise.resolve(answer(path.endsWith("/refresh") ? 200 : 401));
    });
    const bodies: string[] = [];
    const got = await withRenewal(new Request(PLAN, { method: "POST", body: "b" }), async (request) => {
      bodies.push(await request.text());
      return bodies.length === 1 ? answer(401, "token_expired") : answer(201);
    });
    expect(got.status).toBe(201);
    expect(bodies).toEqual(["b", "b"]);
    expect(asked).toEqual(["/api/v1/users/me", "/api/v1/sessions/refresh"]);
  });

  it("does not use up the refresh token when another tab has renewed the session", async () => {
    const asked: string[] = [];
    vi.stubGlobal("fetch", (path: string) => {
      asked.push(path);
      return Promise.resolve(answer(200));
    });
    let sent = 0;
    await withRenewal(new Request(PLAN), () =>
      Promise.resolve(answer(sent++ === 0 ? 401 : 200, "token_missing")),
    );
    expect(asked).toEqual(["/api/v1/users/me"]);
  });

  it("gives the refusal when the session has ended, and never renews for a wrong password", async () => {
    const fetched = vi.fn(() => Promise.resolve(answer(401)));
    vi.stubGlobal("fetch", fetched);
    const ended = await withRenewal(new Request(PLAN), () => Promise.resolve(answer(401, "token_expired")));
    expect(ended.status).toBe(401);
    fetched.mockClear();
    await withRenewal(new Request("http://localhost/api/v1/sessions"), () =>
      Promise.resolve(answer(401, "login_failed")),
    );
    expect(fetched).not.toHaveBeenCalled();
  });
});
