/**
 * Work on values that may come faster than it can be done: one at a time, and of those that came meanwhile the newest
 * alone.
 */
export class NewestFirst<Value> {
  private next: Value | null = null;
  private isBusy = false;

  constructor(private readonly work: (value: Value) => Promise<void>) {}

  take(value: Value): void {
    this.next = value;
    if (!this.isBusy) void this.run();
  }

  /** What waits is not wanted any more. */
  forget(): void {
    this.next = null;
  }

  private async run(): Promise<void> {
    this.isBusy = true;
    while (this.next !== null) {
      const value = this.next;
      this.next = null;
      await this.work(value).catch(() => undefined); // a broken one is followed by a whole one
    }
    this.isBusy = false;
  }
}
