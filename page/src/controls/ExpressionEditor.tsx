/** An expression, sent while it is typed; the column of a mistake is marked in the text. */

import { setValues } from "../session/session";
import { type EditorProps, useProblem, useValue } from "./attribute";
import styles from "./controls.module.css";
import { useStep } from "./step";

/** The text, with a mark under the character at `column`, which is counted from 1. */
function Marked({ text, column }: { text: string; column: number | null }) {
  if (column === null) return <>{`${text}\n`}</>;
  // The server counts characters; JavaScript's string indices count some of them twice.
  const characters = Array.from(text);
  return (
    <>
      {characters.slice(0, column - 1).join("")}
      {/* A mistake may be beyond the end of the text: then a blank is marked. */}
      <mark className={styles.mistake}>{characters[column - 1] ?? " "}</mark>
      {`${characters.slice(column).join("")}\n`}
    </>
  );
}

export function ExpressionEditor({ control, describedBy }: EditorProps) {
  const value = useValue(control.path);
  const text = typeof value === "string" ? value : "";
  const problem = useProblem(control);
  const step = useStep();
  return (
    // The copy behind the field carries the mark, and gives the field its height.
    <div className={styles.expression} data-wrong={problem !== null}>
      <pre className={styles.expressionCopy} aria-hidden>
        <Marked text={text} column={problem?.column ?? null} />
      </pre>
      <textarea
        className={styles.expressionField}
        rows={1}
        spellCheck={false}
        autoCapitalize="off"
        aria-label={control.label}
        aria-describedby={describedBy}
        aria-invalid={problem !== null}
        placeholder="none"
        value={text}
        onChange={(event) => setValues({ [control.path]: event.currentTarget.value }, step.name())}
      />
    </div>
  );
}
