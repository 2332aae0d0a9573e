/** The dialog that asks how to render the final picture. */

import { Button, Checkbox, Modal, TextInput } from "@mantine/core";
import { useEffect, useState } from "react";
import { NumberField, type NumberFieldProps } from "../common/NumberField";
import { bytes, duration } from "../common/numbers";
import type { Estimate } from "../protocol";
import { askEstimate, forgetEstimate, picture, session, startRender } from "../session/session";
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

/** Milliseconds without a change before the server is asked for an estimate. */
const CALM = 400;

/** What a render takes, in words; the server measures it anew when the settings, the shot or the view change. */
function useEstimate({ passes, frames, size, denoise }: Omit<Estimate, "type" | "number">): string {
  const found = useStore(session, (state) => state.estimate);
  const edition = useStore(session, (state) => state.edition);
  const { camera, pose, frame, bounces, stereo } = useStore(session, (state) => state.show);
  const open = useStore(session, (state) => state.open);
  const asked = JSON.stringify([{ passes, frames, size, denoise }, [camera, pose, frame, bounces, stereo]]);
  useEffect(() => {
    const [wanted] = JSON.parse(asked) as [Omit<Estimate, "type" | "number">];
    const timer = window.setTimeout(() => askEstimate(wanted), CALM);
    return () => {
      window.clearTimeout(timer);
      forgetEstimate();
    };
  }, [asked, edition, open]);
  if (found === null) return "Estimating…";
  if (found.seconds === null || found.memory === null) return found.problem ?? "There is no estimate.";
  return `About ${duration(found.seconds)}, ${bytes(found.memory)}`;
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
  const wanted = {
    passes,
    frames: several ? ([first, last] satisfies [number, number]) : null,
    size: [width, height] satisfies [number, number],
    denoise,
  };
  const estimate = useEstimate(wanted);
  return (
    <form
      className={styles.form}
      onSubmit={(event) => {
        event.preventDefault();
        startRender({ ...wanted, file: file.trim() || null });
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
        {estimate}
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
