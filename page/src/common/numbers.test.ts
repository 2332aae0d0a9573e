import { expect, test } from "vitest";
import { bytes, duration } from "./numbers";

test("seconds are said as people say them", () => {
  const said = [0.2, 42.4, 89, 90, 117, 200, 584, 597, 600, 1510, 5399, 5400].map(duration);
  expect(said.slice(0, 6)).toEqual(["1 s", "42 s", "89 s", "1 min 30 s", "2 min", "3 min 20 s"]);
  expect(said.slice(6)).toEqual(["9 min 40 s", "10 min", "10 min", "25 min", "90 min", "1.5 h"]);
});

test("memory has two digits", () => {
  expect([8.431e8, 1.04e9, 1.24e9, 9.94e9, 1.26e10].map(bytes)).toEqual(["850 MB", "1.0 GB", "1.2 GB", "9.9 GB", "13 GB"]);
});
