/** An attribute as its editor sees it. */

import type { ControlItem, ProblemText, Value, Values } from "../protocol";
import { isRamp } from "../session/ramp";
import { session, setValues } from "../session/session";
import { useStore } from "../session/store";

/** The attributes that a control edits: three for a ramp, else one. */
export function paths(control: ControlItem): string[] {
  return isRamp(control) ? Object.values(control.parts) : [control.path];
}

export function useValue(path: string): Value {
  return useStore(session, (state) => state.values[path] ?? null);
}

export function useAuthored(control: ControlItem): boolean {
  return useStore(session, (state) => paths(control).some((path) => state.authored[path]));
}

/** Whether a control has an effect: whether what it needs is so. */
export function hasEffect(control: ControlItem, values: Values): boolean {
  return Object.entries(control.needs).every(([path, wanted]) => {
    const value = values[path] ?? null;
    if (wanted.length > 0) return wanted.some((each) => each === value);
    return Array.isArray(value) ? value.length > 0 : Boolean(value);
  });
}

/** The scene's problem, if it is about this control. */
export function useProblem(control: ControlItem): ProblemText | null {
  return useStore(session, (state) => {
    const problem = state.state?.problem ?? null;
    const own = problem?.path && (problem.path === control.path || paths(control).includes(problem.path));
    return own ? problem : null;
  });
}

export function reset(control: ControlItem): void {
  setValues(Object.fromEntries(paths(control).map((path) => [path, null])));
}

/** What every editor is given. `describedBy` is the id of the control's description. */
export interface EditorProps<Kind extends ControlItem = ControlItem> {
  control: Kind;
  describedBy: string;
}

/** What a screen reader calls the control: labels repeat from light to light, so the prim comes with it. */
export function spokenLabel(control: ControlItem): string {
  return control.unit ? `${control.label} in ${control.unit}` : control.label;
}
