import { expect, test } from "vitest";
import { move, orbit, type Pose, pivotDistance, turn, upward } from "./pose";

/** Six units behind the origin, one above it, looking along −z. */
const START: Pose = [1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 6, 0, 0, 0, 1];
const Y = upward("Y");

const place = (pose: Pose): number[] => [pose[3]!, pose[7]!, pose[11]!];
const back = (pose: Pose): number[] => [pose[2]!, pose[6]!, pose[10]!];

test("orbiting keeps the horizon level in worlds of either up axis", () => {
  // Looks along +y with +z up, as cameras of Z-up stages do.
  const upright: Pose = [1, 0, 0, 0, 0, 0, -1, -6, 0, 1, 0, 2, 0, 0, 0, 1];
  for (const [start, axis, height] of [
    [START, "Y", 1],
    [upright, "Z", 2],
  ] as const) {
    const after = orbit(start, upward(axis), 6, 0.7, -0.4);
    // The camera's right axis, its first column, has no part upward; its up axis has.
    expect(after[4 * height]).toBeCloseTo(0);
    expect(after[4 * height + 1]).toBeGreaterThan(0.5);
  }
});

test("the pivot is where the view passes the origin", () => {
  expect(pivotDistance(START)).toBeCloseTo(6);
});

test("orbiting to the right goes to the left of the pivot, which stays where it is", () => {
  const after = orbit(START, Y, 6, -0.5, 0);
  expect(place(after)[0]).toBeLessThan(0);
  const pivot = place(move(after, 0, 0, 6));
  [0, 1, 0].forEach((each, i) => expect(pivot[i]).toBeCloseTo(each));
});

test("the camera never turns over", () => {
  let pose = START;
  for (let i = 0; i < 100; i++) pose = turn(pose, Y, 0, 0.1);
  expect(back(pose)[1]).toBeCloseTo(-Math.sin((89 * Math.PI) / 180));
  expect(pose[5]).toBeGreaterThan(0);
});

test("a scale above the camera does not change its speed", () => {
  const scaled = START.map((each, i) => (i % 4 < 3 && i < 12 ? 3 * each : each));
  expect(place(move(scaled, 0, 0, 2))).toEqual([0, 1, 4]);
});
