/** One undo step for each action of the user: a drag, a burst of key presses or of typing. */

import { useMemo } from "react";
import { newStep } from "../session/edits";

/** Edits that follow each other within these milliseconds are one step. */
const PAUSE = 1000;

export interface Step {
  /** The name to send with an edit. */
  name(): string;
  /** A drag begins: it is one step however slow it is. */
  hold(): void;
  release(): void;
}

export function useStep(): Step {
  return useMemo(() => {
    let current: string | null = null;
    let until = 0;
    let held = false;
    return {
      name() {
        const now = performance.now();
        if (current === null || (!held && now > until)) current = newStep();
        until = now + PAUSE;
        return current;
      },
      hold() {
        current = null;
        held = true;
      },
      release() {
        if (held) current = null;
        held = false;
      },
    };
  }, []);
}
