/** One control: its name, its editor, a button that resets it, and its problem if it has one. */

import { ActionIcon } from "@mantine/core";
import { type ComponentType, memo, useId } from "react";
import { ResetIcon } from "../common/icons";
import type { ControlItem } from "../protocol";
import { isRamp } from "../session/ramp";
import { RampEditor } from "../ramp/RampEditor";
import { session } from "../session/session";
import { useStore } from "../session/store";
import { type EditorProps, hasEffect, reset, useAuthored, useProblem } from "./attribute";
import { ColorEditor } from "./ColorEditor";
import styles from "./controls.module.css";
import { ExpressionEditor } from "./ExpressionEditor";
import { NumberEditor } from "./NumberEditor";
import { panel } from "./panel";
import { BoolEditor, ChoiceEditor, NumbersEditor, PathsEditor, TextEditor } from "./SmallEditors";

const EDITORS: Record<Exclude<ControlItem["kind"], "ramp">, ComponentType<EditorProps>> = {
  number: NumberEditor,
  integer: NumberEditor,
  bool: BoolEditor,
  color: ColorEditor,
  choice: ChoiceEditor,
  text: TextEditor,
  asset: TextEditor,
  expression: ExpressionEditor,
  numbers: NumbersEditor,
  paths: PathsEditor,
};

/** Editors that need the panel's whole width, below their label. */
const WIDE: ReadonlySet<string> = new Set(["expression", "ramp", "paths"]);

/** The names of what a control needs to have an effect. */
function needed(control: ControlItem): string {
  const names = Object.keys(control.needs).map((path) => path.slice(path.lastIndexOf(".") + 1));
  return names.map((name) => name.replace(/^(photonbeams|inputs):/, "")).join(", ");
}

export const ControlRow = memo(function ControlRow({ control }: { control: ControlItem }) {
  const id = useId();
  const authored = useAuthored(control);
  const problem = useProblem(control);
  const effective = useStore(session, ({ values }) => hasEffect(control, values));
  const explain = (): void => panel.set({ explained: control });
  const Editor = control.kind === "ramp" ? null : EDITORS[control.kind];
  return (
    <div
      className={styles.row}
      data-wide={WIDE.has(control.kind)}
      data-authored={authored}
      data-idle={!effective}
      title={effective ? undefined : `Without effect now: it needs ${needed(control)}`}
      role="group"
      aria-label={control.label}
      onPointerEnter={explain}
      onFocus={explain}
    >
      <span className={styles.label}>
        {control.label}
        {control.unit && <span className={styles.unit}> {control.unit}</span>}
      </span>
      <div className={styles.editor}>
        {isRamp(control) ? (
          <RampEditor control={control} describedBy={id} />
        ) : (
          Editor && <Editor control={control} describedBy={id} />
        )}
      </div>
      <span className={styles.reset}>
        {authored && (
          <ActionIcon
            size="xs"
            variant="subtle"
            color="gray"
            aria-label={`Reset ${control.label} to its default`}
            title="Back to the default"
            onClick={() => reset(control)}
          >
            <ResetIcon />
          </ActionIcon>
        )}
      </span>
      {problem && (
        <p className={styles.problem} role="status">
          {problem.text}
        </p>
      )}
      <span id={id} hidden>
        {control.doc}
      </span>
    </div>
  );
});
