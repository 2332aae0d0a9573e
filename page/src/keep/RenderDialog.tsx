/** The dialog that asks how to render the final picture. */

import { Button, Checkbox, Modal, TextInput } from "@mantine/core";
import { useState } from "react";
import { NumberField, type NumberFieldProps } from "../common/NumberField";
import { picture, session, startRender } from "../session/session";
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

/** Seconds as people say them. */
function spoken(seconds: number): string {
  if (seconds < 90) return `${Math.max(Math.round(seconds), 1)} s`;
  return seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
}

/** How long a pass of the picture that is shown took, for each pixel; null while there is none. */
function useSecondsPerPixel(): number | null {
  const state = useStore(session, (all) => all.state);
  const shown = useStore(picture, (all) => all.shown);
  if (!state || !shown || state.passes === 0 || shown.header.version !== state.version) return null;
  return state.seconds / shown.header.passes / (shown.header.width * shown.header.height);
}

function RenderForm({ onClose }: { onClose: () => void }) {
  const range = useStore(session, (state) => state.scene?.frames ?? null);
  const planned = useStore(session, (state) => state.state?.planned ?? 64);
  const present = useStore(picture, (state) => state.shown);
  const [passes, setPasses] = useState(planned);
  const [several, setSeveral] = useState(false);
  const [denoise, setDenoise] = useState(false);
  const [file, setFile] = useState("");
  const [[first, last], setFrames] = useState<[number, number]>(range ?? [0, 0]);
  const shownSize = session.get().show.size;
  // A preview has few pixels, but its shape.
  const aspect = present ? present.bitmap.width / present.bitmap.height : shownSize[0] / shownSize[1];
  const whole = present && present.header.scale >= 1 ? [present.bitmap.width, present.bitmap.height] : null;
  const [width, setWidth] = useState(whole?.[0] ?? shownSize[0]);
  const [height, setHeight] = useState(whole?.[1] ?? Math.round(shownSize[0] / aspect));
  const each = useSecondsPerPixel();
  const count = several ? last - first + 1 : 1;
  return (
    <form
      className={styles.form}
      onSubmit={(event) => {
        event.preventDefault();
        startRender({
          passes,
          frames: several ? [first, last] : null,
          size: [width, height],
          denoise,
          file: file.trim() || null,
        });
        onClose();
      }}
    >
      <div className={styles.field}>
        <Field text="Passes" label="Passes" first min={1} max={65_536} value={passes} onChange={setPasses} />
        <Checkbox
          size="xs"
          label="Denoise"
          checked={denoise}
          onChange={(event) => setDenoise(event.currentTarget.checked)}
        />
      </div>
      <div className={styles.field}>
        <Field
          text="Size"
          label="Width"
          min={1}
          max={16_384}
          value={width}
          onChange={(value) => {
            setWidth(value);
            setHeight(Math.max(Math.round(value / aspect), 1));
          }}
        />
        <Field text="×" label="Height" min={1} max={16_384} value={height} onChange={setHeight} />
        <span>pixels</span>
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
      <TextInput
        size="xs"
        label="File"
        description={`In the folder of the stage, .exr or .png${several ? ", with #### for the frame" : ""}. Empty: a download.`}
        placeholder="download"
        value={file}
        onChange={(event) => setFile(event.currentTarget.value)}
      />
      <p className={styles.estimate} role="status">
        {each === null
          ? "There is an estimate once the whole picture has a pass."
          : `About ${spoken(each * width * height * passes * count)}, if the machine stays as busy as it is now.`}
      </p>
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
