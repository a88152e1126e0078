import { expect, it } from "vitest";
import { NewestFirst } from "./newestFirst";

function held() {
  const done: number[] = [];
  const ends: (() => void)[] = [];
  const line = new NewestFirst<number>(async (value) => {
    await new Promise<void>((end) => ends.push(end));
    if (value < 0) throw new Error("broken");
    done.push(value);
  });
  const end = async () => {
    ends.shift()?.();
    await new Promise((settled) => setTimeout(settled, 0));
  };
  return { line, done, end };
}

it("passes over what came while it was busy, but for the newest", async () => {
  const { line, done, end } = held();
  for (const value of [1, 2, 3]) line.take(value);
  await end();
  await end();
  expect(done).toEqual([1, 3]);
});

it("goes on after a value that cannot be worked on", async () => {
  const { line, done, end } = held();
  line.take(-1);
  await end();
  line.take(2);
  await end();
  expect(done).toEqual([2]);
});

it("does not begin what is not wanted any more", async () => {
  const { line, done, end } = held();
  for (const value of [1, 2]) line.take(value);
  line.forget();
  await end();
  await end();
  expect(done).toEqual([1]);
});
