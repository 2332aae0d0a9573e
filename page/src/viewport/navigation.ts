/** Free movement of the camera by pointer, wheel and keys. */

import { type PointerEvent as ReactPointerEvent, type RefObject, useEffect, useRef } from "react";
import { session, show } from "../session/session";
import { move, orbit, turn } from "./pose";
import { orbitDistance, presentPose, view, worldUp } from "./view";

const RADIANS_PER_PIXEL = 0.006;
const TURN_PER_SECOND = 1.2;
/** In distances to the pivot, so that the speed suits a room as well as a landscape. */
const FLIGHT_PER_SECOND = 0.7;
const CLOSEST = 1e-3;

const FLIGHT: Record<string, [right: number, up: number, forward: number]> = {
  KeyW: [0, 0, 1],
  KeyS: [0, 0, -1],
  KeyA: [-1, 0, 0],
  KeyD: [1, 0, 0],
  KeyE: [0, 1, 0],
  KeyQ: [0, -1, 0],
};
const TURNS: Record<string, [yaw: number, pitch: number]> = {
  ArrowLeft: [1, 0],
  ArrowRight: [-1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

/** Orbit, or pan, by a pointer's movement in pixels of a picture that is `width` pixels wide. */
function drag(dx: number, dy: number, pan: boolean, width: number): void {
  const pose = presentPose();
  if (!pose) return;
  const distance = orbitDistance();
  view.set({ distance });
  if (pan) {
    // How far the pivot moves for one pixel; the focal length is in widths of the picture.
    const perPixel = distance / (width * (session.get().scene?.focal || 1));
    show({ pose: move(pose, -dx * perPixel, dy * perPixel, 0) });
  } else {
    show({ pose: orbit(pose, worldUp(), distance, -dx * RADIANS_PER_PIXEL, -dy * RADIANS_PER_PIXEL) });
  }
}

function dolly(factor: number): void {
  const pose = presentPose();
  if (!pose) return;
  const distance = orbitDistance();
  const next = Math.max(distance * factor, CLOSEST);
  view.set({ distance: next });
  show({ pose: move(pose, 0, 0, distance - next) });
}

/** Handlers for dragging, for the element that shows the picture. */
export function useDragNavigation(pictureWidth: () => number) {
  const last = useRef<[number, number] | null>(null);
  return {
    onPointerDown(event: ReactPointerEvent<HTMLElement>): void {
      if (event.button > 1) return;
      event.preventDefault();
      event.currentTarget.focus();
      event.currentTarget.setPointerCapture(event.pointerId);
      last.current = [event.clientX, event.clientY];
    },
    onPointerMove(event: ReactPointerEvent<HTMLElement>): void {
      if (!last.current) return;
      const [x, y] = last.current;
      last.current = [event.clientX, event.clientY];
      drag(event.clientX - x, event.clientY - y, event.shiftKey || (event.buttons & 4) !== 0, pictureWidth());
    },
    onPointerUp(): void {
      last.current = null;
    },
    onPointerCancel(): void {
      last.current = null;
    },
  };
}

/** Dolly by the wheel. React's own wheel handlers cannot keep the page from scrolling. */
export function useWheel(element: RefObject<HTMLElement | null>): void {
  useEffect(() => {
    const target = element.current;
    const onWheel = (event: WheelEvent): void => {
      event.preventDefault();
      const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? event.deltaY * 16 : event.deltaY;
      dolly(Math.exp(0.0012 * Math.max(-200, Math.min(200, pixels))));
    };
    target?.addEventListener("wheel", onWheel, { passive: false });
    return () => target?.removeEventListener("wheel", onWheel);
  }, [element]);
}

/** Fly and turn while keys are held and the element has the focus. */
export function useFlight(element: RefObject<HTMLElement | null>): void {
  useEffect(() => {
    const target = element.current;
    if (!target) return;
    const held = new Set<string>();
    let fast = false;
    let before = 0;
    let animation = 0;

    const step = (now: number): void => {
      const seconds = Math.min((now - before) / 1000, 0.1);
      before = now;
      let pose = presentPose();
      if (!pose || held.size === 0) {
        animation = 0;
        return;
      }
      const distance = orbitDistance();
      view.set({ distance });
      const path = seconds * FLIGHT_PER_SECOND * distance * view.get().speed * (fast ? 4 : 1);
      const angle = seconds * TURN_PER_SECOND;
      for (const code of held) {
        const [right, up, forward] = FLIGHT[code] ?? [0, 0, 0];
        const [yaw, pitch] = TURNS[code] ?? [0, 0];
        pose = move(pose, right * path, up * path, forward * path);
        if (code in TURNS) pose = turn(pose, worldUp(), yaw * angle, pitch * angle);
      }
      show({ pose });
      animation = requestAnimationFrame(step);
    };
    const onKeyDown = (event: KeyboardEvent): void => {
      if (event.target !== target || event.ctrlKey || event.metaKey || event.altKey) return;
      fast = event.shiftKey;
      // With the other tools, the arrow keys move the rectangle or the inspected pixel.
      const turns = event.code in TURNS && view.get().tool === "navigate";
      if (!(event.code in FLIGHT) && !turns) return;
      event.preventDefault();
      held.add(event.code);
      if (animation === 0) {
        before = performance.now();
        animation = requestAnimationFrame(step);
      }
    };
    const onKeyUp = (event: KeyboardEvent): void => {
      held.delete(event.code);
      fast = event.shiftKey;
    };
    const letGo = (): void => held.clear();
    target.addEventListener("keydown", onKeyDown);
    target.addEventListener("keyup", onKeyUp);
    target.addEventListener("blur", letGo);
    return () => {
      cancelAnimationFrame(animation);
      target.removeEventListener("keydown", onKeyDown);
      target.removeEventListener("keyup", onKeyUp);
      target.removeEventListener("blur", letGo);
    };
  }, [element]);
}
