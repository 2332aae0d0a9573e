/** The line between a kept snapshot, on the left, and the present picture. */

import type { KeyboardEvent, PointerEvent } from "react";
import { useStore } from "../session/store";
import type { Box } from "./Viewport";
import { view } from "./view";
import styles from "./viewport.module.css";

const STEP = 0.02;

function moveTo(at: number): void {
  view.set({ wipeAt: Math.min(Math.max(at, 0), 1) });
}

export function WipeLine({ box }: { box: Box }) {
  const at = useStore(view, (state) => state.wipeAt);

  const onPointerDown = (event: PointerEvent<HTMLElement>): void => {
    event.currentTarget.setPointerCapture(event.pointerId);
  };
  const onPointerMove = (event: PointerEvent<HTMLElement>): void => {
    const bounds = event.currentTarget.parentElement?.getBoundingClientRect();
    if (event.buttons === 0 || !bounds) return;
    moveTo((event.clientX - bounds.left - box.left) / box.width);
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    const places: Record<string, number> = {
      ArrowLeft: at - STEP,
      ArrowDown: at - STEP,
      ArrowRight: at + STEP,
      ArrowUp: at + STEP,
      Home: 0,
      End: 1,
    };
    const place = places[event.key];
    if (place === undefined) return;
    event.preventDefault();
    moveTo(place);
  };

  return (
    <div
      className={styles.wipe}
      style={{ left: box.left + at * box.width, top: box.top, height: box.height }}
      role="slider"
      tabIndex={0}
      aria-label="Wipe line: snapshot on the left, present picture on the right"
      aria-valuemin={0}
      aria-valuemax={100}
      aria-valuenow={Math.round(100 * at)}
      onPointerDown={onPointerDown}
      onPointerMove={onPointerMove}
      onKeyDown={onKeyDown}
    >
      <span className={styles.wipeSide} aria-hidden>
        A
      </span>
      <span className={styles.wipeSide} aria-hidden>
        B
      </span>
    </div>
  );
}
