/** Moving a camera about: orbit, pan, dolly, turn, fly. Poses are camera-to-world matrices, row by row. */

import type { Triple } from "../protocol";

/** 16 numbers. */
export type Pose = number[];

const add = (a: Triple, b: Triple, factor = 1): Triple => [
  a[0] + factor * b[0],
  a[1] + factor * b[1],
  a[2] + factor * b[2],
];
const dot = (a: Triple, b: Triple): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a: Triple, b: Triple): Triple => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
const unit = (a: Triple): Triple => add([0, 0, 0], a, 1 / (Math.hypot(...a) || 1));

interface Frame {
  right: Triple;
  up: Triple;
  back: Triple;
  at: Triple;
}

function column(pose: Pose, index: number): Triple {
  return [pose[index] ?? 0, pose[index + 4] ?? 0, pose[index + 8] ?? 0];
}

/** A pose's axes, of unit length and at right angles whatever scale the camera's parents have. */
function frame(pose: Pose): Frame {
  const back = unit(column(pose, 2));
  const right = unit(cross(column(pose, 1), back));
  return { right, up: cross(back, right), back, at: column(pose, 3) };
}

function pose({ right, up, back, at }: Frame): Pose {
  return [...[0, 1, 2].flatMap((row) => [right, up, back, at].map((axis) => axis[row] ?? 0)), 0, 0, 0, 1];
}

function rotate(vector: Triple, axis: Triple, angle: number): Triple {
  const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
  const turned = add(add([0, 0, 0], vector, cosine), cross(axis, vector), sine);
  return add(turned, axis, dot(axis, vector) * (1 - cosine));
}

/** Which way is up in a world with this up axis. */
export function upward(axis: "Y" | "Z"): Triple {
  return axis === "Z" ? [0, 0, 1] : [0, 1, 0];
}

/** A first guess of the pivot's distance: where the view passes the world's origin, where most subjects are. */
export function pivotDistance(start: Pose): number {
  const { back, at } = frame(start);
  const along = dot(at, back);
  const far = Math.hypot(...at);
  return along > 0.1 * far && along > 0 ? along : Math.max(far / 2, 1);
}

/** Turn on the spot; angles in radians, positive to the left and up. Stops before the camera would turn over. */
export function turn(start: Pose, worldAxis: Triple, yaw: number, pitch: number): Pose {
  const { right, back, at } = frame(start);
  const elevation = Math.asin(Math.max(-1, Math.min(1, -dot(back, worldAxis))));
  const limit = (89 * Math.PI) / 180;
  // A camera that already looks steeper than the limit may only come back.
  const next = Math.max(Math.min(elevation + pitch, Math.max(limit, elevation)), Math.min(-limit, elevation));
  const tilted = rotate(back, right, next - elevation);
  const newBack = unit(rotate(tilted, worldAxis, yaw));
  const newRight = unit(rotate(right, worldAxis, yaw));
  return pose({ right: newRight, up: cross(newBack, newRight), back: newBack, at });
}

/** Move along the camera's own axes: to the right, up, and forward. */
export function move(start: Pose, right: number, up: number, forward: number): Pose {
  const axes = frame(start);
  const at = add(add(add(axes.at, axes.right, right), axes.up, up), axes.back, -forward);
  return pose({ ...axes, at });
}

/** Turn about a point in front of the camera. */
export function orbit(start: Pose, worldAxis: Triple, distance: number, yaw: number, pitch: number): Pose {
  return move(turn(move(start, 0, 0, distance), worldAxis, yaw, pitch), 0, 0, -distance);
}
