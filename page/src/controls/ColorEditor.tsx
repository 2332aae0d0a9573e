/** A linear colour of any intensity: a swatch that opens the picker, and its sRGB code. */

import type { Triple } from "../protocol";
import { setValues } from "../session/session";
import { type EditorProps, useValue } from "./attribute";
import { ColorButton } from "./ColorButton";
import { useStep } from "./step";

export function ColorEditor({ control, describedBy }: EditorProps) {
  const value = useValue(control.path);
  const step = useStep();
  const color = (Array.isArray(value) && value.length === 3 ? value : [0, 0, 0]) as Triple;
  return (
    <ColorButton
      label={control.label}
      describedBy={describedBy}
      color={color}
      step={step}
      onChange={(next) => setValues({ [control.path]: next }, step.name())}
    />
  );
}
