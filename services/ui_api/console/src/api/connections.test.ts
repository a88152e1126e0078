import { expect, it } from "vitest";
import { onSharedConnection, SHARED_CONNECTIONS } from "./connections";

const settled = () => new Promise((done) => setTimeout(done, 0));

it("leaves connections of the browser's six for events, stop and lease, whatever else is asked", async () => {
  const answers: ((answer: Response) => void)[] = [];
  const asked = Array.from({ length: SHARED_CONNECTIONS + 2 }, () =>
    onSharedConnection(() => new Promise<Response>((answer) => answers.push(answer))),
  );
  await settled();
  expect(SHARED_CONNECTIONS).toBeLessThanOrEqual(3);
  expect(answers).toHaveLength(SHARED_CONNECTIONS);
  for (let sent = 0; sent < asked.length; sent++) {
    answers[sent]?.(new Response(`${sent}`, { status: 200, headers: { etag: `"${sent}"` } }));
    await settled();
  }
  const read = await Promise.all(
    asked.map(async (one) => [await (await one).text(), (await one).headers.get("etag")]),
  );
  expect(read).toEqual(asked.map((_, sent) => [`${sent}`, `"${sent}"`]));
});

it("lets what goes first go before what waits already", async () => {
  const answers: ((answer: Response) => void)[] = [];
  const sent: string[] = [];
  const ask = (name: string, goesFirst = false) =>
    onSharedConnection(() => {
      sent.push(name);
      return new Promise<Response>((answer) => answers.push(answer));
    }, goesFirst);
  const under_way = Array.from({ length: SHARED_CONNECTIONS }, () => ask("under way"));
  const others = [ask("waits"), ask("state", true)];
  answers[0]?.(new Response(""));
  await settled();
  expect(sent.slice(SHARED_CONNECTIONS)).toEqual(["state"]);
  for (let i = 1; i < under_way.length + others.length; i++) {
    answers[i]?.(new Response(""));
    await settled();
  }
  await Promise.all([...under_way, ...others]);
});

it("gives the connection back when a request fails, and takes an answer without a body", async () => {
  for (let i = 0; i <= SHARED_CONNECTIONS; i++)
    await expect(onSharedConnection(() => Promise.reject(new Error("gone")))).rejects.toThrow("gone");
  const answer = await onSharedConnection(() => Promise.resolve(new Response(null, { status: 204 })));
  expect(answer.status).toBe(204);
});
