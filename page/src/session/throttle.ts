/** About 30 messages a second: smooth to the eye, and no more than the server can use. */
export const SEND_INTERVAL = 33;

/** Calls `act` at once, then at most once per interval; requests that come earlier are one call at its end. */
export class Throttle {
  private last = -Infinity;
  private timer: number | undefined;

  constructor(private readonly act: () => void) {}

  request(): void {
    if (this.timer !== undefined) return;
    const wait = this.last + SEND_INTERVAL - performance.now();
    if (wait <= 0) this.flush();
    else this.timer = window.setTimeout(() => this.flush(), wait);
  }

  flush(): void {
    window.clearTimeout(this.timer);
    this.timer = undefined;
    this.last = performance.now();
    this.act();
  }
}
