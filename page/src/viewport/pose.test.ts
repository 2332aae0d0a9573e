import { expect, test } from "vitest";
import type { Pose } from "../protocol";
import { move, orbit, pivotDistance, turn, worldUp } from "./pose";

/** Six units behind the origin, one above it, looking along −z. */
const START: Pose = [1, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 6, 0, 0, 0, 1];
const Y = worldUp(START);

const place = (pose: Pose): number[] => [pose[3]!, pose[7]!, pose[11]!];
const back = (pose: Pose): number[] => [pose[2]!, pose[6]!, pose[10]!];

test("up is y or z, whichever the camera stands upright in", () => {
  expect(Y).toEqual([0, 1, 0]);
  // Looks along +y with +z up.
  expect(worldUp([1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1])).toEqual([0, 0, 1]);
  // Looks nearly straight down, in a world whose up is y: turned by 80 degrees about x, and a little about y.
  expect(worldUp(turn(turn(START, Y, 0, -1.4), Y, 0.3, 0))).toEqual([0, 1, 0]);
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
