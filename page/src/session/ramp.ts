/** Ramps among the controls: edited as one thing, but stored as three attributes. */

import type { ControlItem } from "../protocol";

export interface RampControl extends ControlItem {
  kind: "ramp";
  parts: { knots: string; colors: string; interpolation: string };
}

export function isRamp(control: ControlItem): control is RampControl {
  return control.kind === "ramp";
}
