/** Changes of a ramp's keys. A key is a knot and its colour; knots stay in ascending order. */

import { luminance, scaled } from "../common/color";
import type { Triple } from "../protocol";
import { type Ramp, rampCurve } from "./interpolate";

/** The least distance between two keys. */
const GAP = 1e-3;

/** What the curve view edits: one channel, or the brightness of all three. */
export type Channel = 0 | 1 | 2 | "luminance";

export function channelValue(color: Triple, channel: Channel): number {
  return channel === "luminance" ? luminance(color) : color[channel];
}

/** The places that the editor shows: 0 to 1, and whatever lies beyond. */
export function domain(knots: number[]): [number, number] {
  return [Math.min(0, ...knots), Math.max(1, ...knots)];
}

export function moveKey(ramp: Ramp, index: number, to: number): Ramp {
  const [first, last] = domain(ramp.knots);
  const low = index > 0 ? ramp.knots[index - 1]! + GAP : first;
  const high = index < ramp.knots.length - 1 ? ramp.knots[index + 1]! - GAP : last;
  const place = Math.max(low, Math.min(to, high));
  return { ...ramp, knots: ramp.knots.map((knot, i) => (i === index ? place : knot)) };
}

export function paintKey(ramp: Ramp, index: number, color: Triple): Ramp {
  return { ...ramp, colors: ramp.colors.map((old, i) => (i === index ? color : old)) };
}

/** Set one channel of a key; for the luminance the colour is scaled, so that its hue stays. */
export function setKeyValue(ramp: Ramp, index: number, channel: Channel, value: number): Ramp {
  const color = ramp.colors[index]!;
  const next = Math.max(value, 0);
  if (channel !== "luminance") {
    return paintKey(ramp, index, color.map((old, i) => (i === channel ? next : old)) as Triple);
  }
  const before = luminance(color);
  // Black has no hue to keep.
  return paintKey(ramp, index, before > 1e-6 ? scaled(color, Math.max(next, 1e-4) / before) : [next, next, next]);
}

/** Add a key that does not change the ramp's colour there; returns its index too. */
export function addKey(ramp: Ramp, place: number): { ramp: Ramp; index: number } {
  const { knots, colors } = ramp;
  const near = knots.findIndex((knot) => Math.abs(knot - place) < GAP);
  if (near >= 0) return { ramp, index: near };
  const index = knots.filter((knot) => knot < place).length;
  const color = rampCurve(ramp)(place);
  return { ramp: { ...ramp, knots: knots.toSpliced(index, 0, place), colors: colors.toSpliced(index, 0, color) }, index };
}

/** The middle of the widest gap: where a key that is added without a pointer goes. */
export function widestGap(knots: number[]): number {
  const [first, last] = domain(knots);
  const ends = [first, ...knots, last];
  let widest = 0;
  for (let i = 1; i < ends.length - 1; i++) {
    if (ends[i + 1]! - ends[i]! > ends[widest + 1]! - ends[widest]!) widest = i;
  }
  return (ends[widest]! + ends[widest + 1]!) / 2;
}

export function deleteKey(ramp: Ramp, index: number): Ramp {
  return { ...ramp, knots: ramp.knots.toSpliced(index, 1), colors: ramp.colors.toSpliced(index, 1) };
}
