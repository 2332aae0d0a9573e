import { expect, test } from "vitest";
import type { Triple } from "../protocol";
import { channelCurve, rampCurve } from "./interpolate";

const KNOTS = [0, 0.2, 0.7, 1];
const VALUES = [0, 1, 0.3, 2];
const PLACES = [0.1, 0.3, 0.5, 0.9];

// From photonbeams.looks.ramp.interpolate.
const EXPECTED: Record<string, number[]> = {
  none: [0, 1, 1, 0.3],
  linear: [0.5, 0.86, 0.58, 1.4333333],
  smooth: [0.5, 0.9272, 0.5464, 1.5592593],
  catmullRom: [0.54571429, 1.0819048, 0.48142857, 1.3744444],
  monotone: [0.67071429, 0.9272, 0.5464, 1.1896296],
};

test.each(Object.entries(EXPECTED))("%s is interpolated as in the renderer", (interpolation, expected) => {
  const curve = channelCurve(KNOTS, VALUES, interpolation);
  PLACES.forEach((place, i) => expect(curve(place)).toBeCloseTo(expected[i]!, 6));
});

test("a ramp is constant beyond its ends", () => {
  const colors: Triple[] = [
    [1, 0, 0],
    [0, 0, 3],
  ];
  const curve = rampCurve({ knots: [0.25, 0.75], colors, interpolation: "linear" });
  expect(curve(0)).toEqual([1, 0, 0]);
  expect(curve(1)).toEqual([0, 0, 3]);
});

test("one knot alone is constant", () => {
  expect(channelCurve([0.4], [2], "monotone")(0.9)).toBe(2);
});
