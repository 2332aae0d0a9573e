/** Edits on their way to the server: sent at most 30 times a second, and shown at once. */

import type { PageMessage, Value, Values } from "../protocol";
import { Throttle } from "./throttle";

/** After these milliseconds without an answer, the server's value is shown again. */
const PATIENCE = 3000;

/** Part of the steps' names: pages share a session, so the names must differ between pages. */
const PAGE = Math.random().toString(36).slice(2, 8);
let steps = 0;

/** A name for one undo step, to be given to every edit of a drag. */
export function newStep(): string {
  steps += 1;
  return `${PAGE}-${steps}`;
}

/** Equal up to the rounding of a number to 32 bits, which is how the scene stores most of them. */
function sameValue(a: Value | undefined, b: Value | undefined): boolean {
  if (typeof a === "number" && typeof b === "number") return Math.abs(a - b) <= 1e-6 * Math.max(1, Math.abs(a));
  if (Array.isArray(a) && Array.isArray(b)) {
    return a.length === b.length && a.every((each, i) => sameValue(each as Value, b[i] as Value));
  }
  return a === b;
}

export class Edits {
  /** Edits that are not confirmed yet. The page shows them instead of the server's values. */
  private pending = new Map<string, { value: Value; until: number }>();
  private unsent: Values = {};
  private step: string | null = null;
  private throttle = new Throttle(() => this.send());

  constructor(
    private readonly post: (message: PageMessage) => boolean,
    private readonly changed: () => void,
  ) {
    // Some answers never come, such as those for refused values.
    window.setInterval(() => this.expire(), 500);
  }

  set(values: Values, step: string | null): void {
    // Edits of different undo steps must not be in one message.
    if (step !== this.step || step === null) this.flush();
    this.step = step;
    Object.assign(this.unsent, values);
    const until = Date.now() + PATIENCE;
    for (const [path, value] of Object.entries(values)) this.pending.set(path, { value, until });
    this.throttle.request();
    this.changed();
  }

  /** Send now what is waiting; before an undo, for instance. */
  flush(): void {
    if (Object.keys(this.unsent).length > 0) this.throttle.flush();
  }

  /** Show the server's values again. */
  forget(): void {
    this.pending.clear();
    this.changed();
  }

  confirm(values: Values): void {
    for (const [path, value] of Object.entries(values)) {
      const asked = this.pending.get(path);
      if (asked && !(path in this.unsent) && (asked.value === null || sameValue(asked.value, value))) {
        this.pending.delete(path);
      }
    }
  }

  get(path: string): { value: Value } | undefined {
    return this.pending.get(path);
  }

  private send(): void {
    if (Object.keys(this.unsent).length === 0) return;
    // Without a connection the edits wait here; `flush` sends them when it is back.
    if (this.post({ type: "set", values: this.unsent, step: this.step })) this.unsent = {};
  }

  private expire(): void {
    const now = Date.now();
    let expired = false;
    for (const [path, { until }] of this.pending) {
      if (until < now && !(path in this.unsent)) expired = this.pending.delete(path);
    }
    if (expired) this.changed();
  }
}
