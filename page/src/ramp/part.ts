/** What the gradient and the curves of a ramp have in common. */

import type { KeyboardEvent } from "react";
import type { Step } from "../controls/step";
import type { Ramp } from "./interpolate";
import { domain, moveKey } from "./keys";

/** How finely a ramp is drawn. */
const SAMPLES = 96;

export interface PartProps {
  ramp: Ramp;
  /** The control's name, with which the names of keys begin. */
  label: string;
  selected: number;
  step: Step;
  select: (index: number) => void;
  change: (ramp: Ramp) => void;
  remove: (index: number) => void;
}

/** Places along the ramp at which it is drawn; steps need both sides of each knot. */
export function places({ knots, interpolation }: Ramp): number[] {
  const [first, last] = domain(knots);
  const even = Array.from({ length: SAMPLES + 1 }, (_, i) => first + ((last - first) * i) / SAMPLES);
  const sides = interpolation === "none" ? knots.flatMap((knot) => [knot - 1e-6, knot]) : knots;
  return [...even, ...sides].sort((a, b) => a - b);
}

/** Where a pointer is along an element, as a place along the ramp. */
export function placeOf(event: { clientX: number }, element: Element, [first, last]: [number, number]): number {
  const { left, width } = element.getBoundingClientRect();
  return first + ((last - first) * Math.min(Math.max(event.clientX - left, 0), width)) / width;
}

/** Handles a key's movement along the ramp, and its deletion, by the keyboard. */
export function onKeyOfKey(event: KeyboardEvent, index: number, { ramp, change, remove, select }: PartProps): void {
  const [first, last] = domain(ramp.knots);
  const size = (last - first) * (event.shiftKey ? 0.1 : 0.01);
  const direction = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (direction !== undefined) {
    event.preventDefault();
    select(index);
    change(moveKey(ramp, index, ramp.knots[index]! + direction * size));
  } else if (event.key === "Delete" || event.key === "Backspace") {
    event.preventDefault();
    remove(index);
  }
}
