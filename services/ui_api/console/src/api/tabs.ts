// What the tabs of one browser share: they are one client of the gateway, with six connections between them.

/** As `navigator.locks.request`, of which a lock's holder is one of all tabs. */
export interface Locks {
  request<T>(name: string, options: { signal: AbortSignal }, act: () => Promise<T> | T): Promise<T>;
}

/** Locks of this page alone: where the page was not loaded by HTTPS or from this machine, tabs know of no other. */
export class LocksOfPage implements Locks {
  private readonly last = new Map<string, Promise<unknown>>();

  async request<T>(name: string, { signal }: { signal: AbortSignal }, act: () => Promise<T> | T): Promise<T> {
    const turn = (this.last.get(name) ?? Promise.resolve()).then(() => {
      signal.throwIfAborted();
      return act();
    });
    this.last.set(
      name,
      turn.catch(() => undefined),
    );
    return await turn;
  }
}

const ofBrowser = globalThis.navigator?.locks as LockManager | undefined;
export const areTabsShared = ofBrowser !== undefined;
export const locks: Locks = (ofBrowser as Locks | undefined) ?? new LocksOfPage();

/**
 * Take the first of some locks that is free; what it resolves to gives it back. A browser may refuse one of them while
 * it opens a window: then another is waited for, and it is not held for nobody.
 */
export async function firstFree(
  names: readonly string[],
  signal: AbortSignal,
  of: Locks = locks,
): Promise<() => void> {
  const others = new AbortController();
  const wanted = AbortSignal.any([signal, others.signal]);
  const waiting = names.map((name) => {
    return new Promise<() => void>((take, refuse) => {
      const hold = () =>
        new Promise<void>((giveBack) => {
          if (wanted.aborted) return giveBack(); // another was free at the same time, or nobody waits any more
          others.abort();
          take(giveBack);
        });
      const ended = () => refuse(wanted.reason); // of one that was taken it is too late
      of.request(name, { signal: wanted }, hold).then(ended, refuse);
    });
  });
  return await Promise.any(waiting).catch((refused: AggregateError) => {
    throw refused.errors[0];
  });
}
