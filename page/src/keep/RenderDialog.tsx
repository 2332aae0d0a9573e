/** The dialog that asks how to render the final picture. */

import { Button, Checkbox, Modal } from "@mantine/core";
import { useState } from "react";
import { NumberField, type NumberFieldProps } from "../common/NumberField";
import { session, startRender } from "../session/session";
import { useStore } from "../session/store";
import styles from "./keep.module.css";

/** A whole number with a word before it. */
function Field({ text, ...field }: NumberFieldProps & { text: string }) {
  return (
    <>
      <span>{text}</span>
      <NumberField className={styles.number} integer {...field} />
    </>
  );
}

function RenderForm({ onClose }: { onClose: () => void }) {
  const range = useStore(session, (state) => state.scene?.frames ?? null);
  const planned = useStore(session, (state) => state.state?.planned ?? 64);
  const [passes, setPasses] = useState(planned);
  const [several, setSeveral] = useState(false);
  const [[first, last], setFrames] = useState<[number, number]>(range ?? [0, 0]);
  return (
    <form
      className={styles.form}
      onSubmit={(event) => {
        event.preventDefault();
        startRender(passes, several ? [first, last] : null);
        onClose();
      }}
    >
      <div className={styles.field}>
        <Field text="Passes" label="Passes" first min={1} max={65_536} value={passes} onChange={setPasses} />
      </div>
      {range && (
        <Checkbox
          size="xs"
          label="Several frames"
          checked={several}
          onChange={(event) => setSeveral(event.currentTarget.checked)}
        />
      )}
      {range && several && (
        <div className={styles.field}>
          <Field
            text="From"
            label="First frame"
            min={range[0]}
            max={last}
            value={first}
            onChange={(value) => setFrames([value, last])}
          />
          <Field
            text="to"
            label="Last frame"
            min={first}
            max={range[1]}
            value={last}
            onChange={(value) => setFrames([first, value])}
          />
        </div>
      )}
      <div className={styles.buttons}>
        <Button size="xs" variant="default" onClick={onClose}>
          Not now
        </Button>
        <Button size="xs" type="submit">
          Render
        </Button>
      </div>
    </form>
  );
}

export function RenderDialog({ opened, onClose }: { opened: boolean; onClose: () => void }) {
  return (
    <Modal opened={opened} onClose={onClose} title="Render this" size="sm" centered>
      <RenderForm onClose={onClose} />
    </Modal>
  );
}
