/** The state of the viewport: tool, wipe, inspected pixel, free camera. */

import type { Triple } from "../protocol";
import { inspect, session, show } from "../session/session";
import { Store } from "../session/store";
import { type Pose, pivotDistance, upward } from "./pose";

export type Tool = "navigate" | "inspect" | "area";

interface View {
  tool: Tool;
  panel: "controls" | "pixel";
  /** The inspected pixel, in fractions of the picture. */
  at: [number, number];
  /** The snapshot left of the wipe line, and where the line is. */
  wipe: number | null;
  wipeAt: number;
  /** From the camera to the point that it orbits; null: not guessed yet. */
  distance: number | null;
  /** A factor on the speed of flight. */
  speed: number;
}

export const view = new Store<View>({
  tool: "navigate",
  panel: "controls",
  at: [0.5, 0.5],
  wipe: null,
  wipeAt: 0.5,
  distance: null,
  speed: 1,
});

export function presentPose(): Pose | null {
  const { show: shown, scene } = session.get();
  return shown.pose ?? scene?.pose ?? null;
}

/** Which way is up, for a horizon that stays level. */
export function worldUp(): Triple {
  return upward(session.get().scene?.up ?? "Y");
}

export function orbitDistance(): number {
  const { distance } = view.get();
  if (distance !== null) return distance;
  const pose = presentPose();
  return pose ? pivotDistance(pose) : 1;
}

/** Leave the free pose and look through the shot's camera again. */
export function throughTheCamera(): void {
  view.set({ distance: null });
  show({ pose: null });
}

export function inspectAt(at: [number, number]): void {
  const inside: [number, number] = [Math.min(Math.max(at[0], 0), 1), Math.min(Math.max(at[1], 0), 1)];
  view.set({ at: inside, panel: "pixel" });
  inspect(inside);
}
