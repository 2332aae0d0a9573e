/** Colours between a ramp's knots, by the same formulas as the renderer (photonbeams/looks/ramp.py). */

import type { Triple } from "../protocol";

export interface Ramp {
  knots: number[];
  colors: Triple[];
  interpolation: string;
}

/** Slopes from the neighbours, for steps of any length; at the ends the slope to the one neighbour (numpy.gradient). */
function neighbourSlopes(x: number[], y: number[]): number[] {
  const last = x.length - 1;
  const secant = (i: number): number => (y[i + 1]! - y[i]!) / (x[i + 1]! - x[i]!);
  return x.map((_, i) => {
    if (i === 0) return secant(0);
    if (i === last) return secant(last - 1);
    const [before, after] = [x[i]! - x[i - 1]!, x[i + 1]! - x[i]!];
    return (before * secant(i) + after * secant(i - 1)) / (before + after);
  });
}

/** Fritsch and Carlson's slopes, which let no curve overshoot (scipy's PchipInterpolator). */
function monotoneSlopes(x: number[], y: number[]): number[] {
  const last = x.length - 1;
  const length = (i: number): number => x[i + 1]! - x[i]!;
  const secant = (i: number): number => (y[i + 1]! - y[i]!) / length(i);
  if (last === 1) return [secant(0), secant(0)];
  // One-sided, of three points, and limited where it would change the sign or be too steep.
  const end = (h0: number, h1: number, m0: number, m1: number): number => {
    const slope = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1);
    if (Math.sign(slope) !== Math.sign(m0)) return 0;
    return Math.sign(m0) !== Math.sign(m1) && Math.abs(slope) > 3 * Math.abs(m0) ? 3 * m0 : slope;
  };
  return x.map((_, i) => {
    if (i === 0) return end(length(0), length(1), secant(0), secant(1));
    if (i === last) return end(length(last - 1), length(last - 2), secant(last - 1), secant(last - 2));
    const [m0, m1] = [secant(i - 1), secant(i)];
    if (m0 * m1 <= 0) return 0;
    const [w0, w1] = [2 * length(i) + length(i - 1), length(i) + 2 * length(i - 1)];
    return (w0 + w1) / (w0 / m0 + w1 / m1);
  });
}

/** A function that gives one channel's value at a place: constant before the first and after the last knot. */
export function channelCurve(knots: number[], values: number[], interpolation: string): (x: number) => number {
  const last = knots.length - 1;
  if (last < 1) return () => values[0] ?? 0;
  const slopes =
    interpolation === "catmullRom"
      ? neighbourSlopes(knots, values)
      : interpolation === "monotone"
        ? monotoneSlopes(knots, values)
        : null;
  return (x) => {
    const place = Math.min(Math.max(x, knots[0]!), knots[last]!);
    let i = knots.findIndex((knot) => knot > place) - 1;
    if (i < 0) i = last - 1;
    const length = knots[i + 1]! - knots[i]!;
    const [from, to] = [values[i]!, values[i + 1]!];
    let t = (place - knots[i]!) / length;
    const ease = t * t * (3 - 2 * t);
    if (slopes) {
      const bent = t * (1 - t) * ((1 - t) * slopes[i]! - t * slopes[i + 1]!) * length;
      // Catmull–Rom may undershoot: light is not negative.
      return Math.max(from * (1 - ease) + to * ease + bent, 0);
    }
    if (interpolation === "none") t = place >= knots[last]! ? 1 : 0;
    else if (interpolation === "smooth") t = ease;
    return from + t * (to - from);
  };
}

/** A function that gives the ramp's colour at a place. */
export function rampCurve({ knots, colors, interpolation }: Ramp): (x: number) => Triple {
  const channels = [0, 1, 2].map((channel) =>
    channelCurve(
      knots,
      colors.map((color) => color[channel]!),
      interpolation,
    ),
  );
  return (x) => channels.map((curve) => curve(x)) as Triple;
}
