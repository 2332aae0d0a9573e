/** A number: a slider over the usual range, and a field that takes whatever is allowed. */

import { Slider } from "@mantine/core";
import { NumberField } from "../common/NumberField";
import { stepFor } from "../common/numbers";
import { setValues } from "../session/session";
import { type EditorProps, reset, spokenLabel, useProblem, useValue } from "./attribute";
import styles from "./controls.module.css";
import { useStep } from "./step";

export function NumberEditor({ control, describedBy }: EditorProps) {
  const own = useValue(control.path);
  const value = Number(own ?? 0);
  const problem = useProblem(control);
  const step = useStep();
  const integer = control.kind === "integer";
  const { soft, min, max } = control;
  // Without a usual range, the step follows from the size of the number itself.
  const fineness = soft ? stepFor(soft[1] - soft[0]) : stepFor(Math.abs(value) || 1);
  const size = integer ? Math.max(1, Math.round(fineness)) : fineness;
  const set = (next: number): void => setValues({ [control.path]: next }, step.name());
  return (
    <div className={styles.numberEditor}>
      {soft && (
        <Slider
          className={styles.slider}
          size="xs"
          min={soft[0]}
          max={soft[1]}
          step={size}
          label={null}
          thumbLabel={spokenLabel(control)}
          thumbProps={{ "aria-describedby": describedBy }}
          value={Math.min(Math.max(value, soft[0]), soft[1])}
          onChange={set}
          onPointerDown={step.hold}
          onChangeEnd={step.release}
        />
      )}
      <NumberField
        className={styles.numberField}
        label={soft ? `${spokenLabel(control)}, exact` : spokenLabel(control)}
        describedBy={describedBy}
        invalid={problem !== null}
        value={own === null ? null : value}
        none="auto"
        onNone={() => reset(control)}
        min={min}
        max={max}
        step={size}
        integer={integer}
        onChange={set}
      />
    </div>
  );
}
