import { expect, it, vi } from "vitest";
import { type Lane, onConnection } from "./connections";
import { firstFree, type Locks, LocksOfPage } from "./tabs";

const settled = () => new Promise((done) => setTimeout(done, 0));

/** Requests that are answered when the test says so. */
class Gateway {
  readonly sent: string[] = [];
  private readonly answers = new Map<string, (answer: Response) => void>();
  private readonly locks = new LocksOfPage();

  ask(name: string, lane: Lane, signal?: AbortSignal): Promise<Response> {
    const send = () => {
      this.sent.push(name);
      return new Promise<Response>((answer) => this.answers.set(name, answer));
    };
    return onConnection(lane, send, signal, this.locks);
  }

  async answer(name: string, answer = new Response(name)): Promise<void> {
    this.answers.get(name)?.(answer);
    await settled();
  }
}

it("leaves connections of the browser's six for events, stop and lease, whatever else is asked", async () => {
  const gateway = new Gateway();
  const asked = ["a", "b", "c"].map((name) => gateway.ask(name, "usual"));
  const state = ["s", "t"].map((name) => gateway.ask(name, "state"));
  await settled();
  expect(gateway.sent.toSorted()).toEqual(["a", "b", "s"]);
  await gateway.answer("a", new Response("a", { headers: { etag: '"7"' } }));
  expect(gateway.sent).toContain("c");
  await gateway.answer("s");
  expect(gateway.sent).toContain("t");
  for (const name of ["b", "c", "t"]) await gateway.answer(name);
  expect(await Promise.all([...asked, ...state].map(async (one) => await (await one).text()))).toEqual([
    "a",
    "b",
    "c",
    "s",
    "t",
  ]);
  expect((await asked[0])?.headers.get("etag")).toBe('"7"');
});

it("lets what is quick pass what takes seconds, however much of that is asked", async () => {
  const gateway = new Gateway();
  const long = ["plan", "verification"].map((name) => gateway.ask(name, "long"));
  await settled();
  const quick = [gateway.ask("q", "usual")];
  await settled();
  expect(gateway.sent).toEqual(["plan", "q"]);
  for (const name of ["plan", "verification", "q"]) await gateway.answer(name);
  await Promise.all([...long, ...quick]);
});

it("gives the connection back when a request fails, and takes an answer without a body", async () => {
  const locks = new LocksOfPage();
  for (let i = 0; i < 3; i++)
    await expect(
      onConnection("state", () => Promise.reject(new Error("gone")), undefined, locks),
    ).rejects.toThrow("gone");
  const answer = await onConnection(
    "state",
    () => Promise.resolve(new Response(null, { status: 204 })),
    undefined,
    locks,
  );
  expect(answer.status).toBe(204);
});

it("gives the connection back when no answer comes within the limit", async () => {
  const limit = new AbortController();
  const timeout = vi.spyOn(AbortSignal, "timeout").mockReturnValueOnce(limit.signal);
  const silent = (signal: AbortSignal) =>
    new Promise<Response>((_, refuse) => signal.addEventListener("abort", () => refuse(signal.reason)));
  const locks = new LocksOfPage();
  const unanswered = expect(onConnection("state", silent, undefined, locks)).rejects.toThrow("too late");
  await settled();
  limit.abort(new Error("too late"));
  await unanswered;
  timeout.mockRestore();
  const next = onConnection("state", () => Promise.resolve(new Response("next")), undefined, locks);
  expect(await (await next).text()).toBe("next");
});

it("sends nothing for whoever has left while it waited", async () => {
  const gateway = new Gateway();
  const first = gateway.ask("first", "state");
  const leaving = new AbortController();
  const left = expect(gateway.ask("left", "state", leaving.signal)).rejects.toThrow("aborted");
  await settled();
  leaving.abort();
  await gateway.answer("first");
  await first;
  await left;
  expect(gateway.sent).toEqual(["first"]);
});

/** As a browser does while it opens a window: it refuses what it would have given. */
class RefusingFirst implements Locks {
  private readonly of = new LocksOfPage();
  constructor(private readonly refused: string) {}

  async request<T>(name: string, options: { signal: AbortSignal }, act: () => Promise<T> | T): Promise<T> {
    if (name === this.refused) throw new Error("no longer runnable");
    return await this.of.request(name, options, act);
  }
}

it("takes another lock where one is refused, and gives it back", async () => {
  const never = new AbortController().signal;
  for (const refused of ["1", "2"]) {
    const locks = new RefusingFirst(refused);
    for (let i = 0; i < 3; i++) (await firstFree(["1", "2"], never, locks))();
  }
  await expect(firstFree(["1"], never, new RefusingFirst("1"))).rejects.toThrow("no longer runnable");
});

it("settles when a lock becomes free for whoever has just left", async () => {
  const leaving = new AbortController();
  const locks = new LocksOfPage();
  const giveBack = await firstFree(["1"], new AbortController().signal, locks);
  const late = expect(firstFree(["1"], leaving.signal, new GivingLate(locks))).rejects.toThrow("aborted");
  leaving.abort();
  giveBack();
  await late;
});

/** Gives also what is not wanted any more: the grant was under way. */
class GivingLate implements Locks {
  constructor(private readonly of: Locks) {}

  async request<T>(name: string, _options: { signal: AbortSignal }, act: () => Promise<T> | T): Promise<T> {
    return await this.of.request(name, { signal: new AbortController().signal }, act);
  }
}
