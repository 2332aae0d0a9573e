/** The editor of a ramp: its gradient with the keys, its curves, and the details of the chosen key. */

import { ActionIcon, Button, NativeSelect, SegmentedControl } from "@mantine/core";
import { useState } from "react";
import { DeleteIcon } from "../common/icons";
import { NumberField } from "../common/NumberField";
import { type EditorProps, useValue } from "../controls/attribute";
import { ColorButton } from "../controls/ColorButton";
import { useStep } from "../controls/step";
import type { Triple } from "../protocol";
import type { RampControl } from "../session/ramp";
import { setValues } from "../session/session";
import { CurveView } from "./CurveView";
import { GradientBar } from "./GradientBar";
import type { Ramp } from "./interpolate";
import { addKey, type Channel, deleteKey, moveKey, paintKey, widestGap } from "./keys";
import type { PartProps } from "./part";
import styles from "./ramp.module.css";

/** The curves to choose from: all three channels by their brightness, or one. */
const CHANNELS: { value: string; label: string; name: string; channel: Channel }[] = [
  { value: "all", label: "All", name: "brightness", channel: "luminance" },
  { value: "red", label: "R", name: "red", channel: 0 },
  { value: "green", label: "G", name: "green", channel: 1 },
  { value: "blue", label: "B", name: "blue", channel: 2 },
];

function useRamp({ parts }: RampControl): Ramp {
  const knots = (useValue(parts.knots) ?? []) as number[];
  const colors = (useValue(parts.colors) ?? []) as Triple[];
  const interpolation = String(useValue(parts.interpolation) ?? "linear");
  // While a message has changed only one of the two, their lengths may differ.
  const count = Math.min(knots.length, colors.length);
  return { knots: knots.slice(0, count), colors: colors.slice(0, count), interpolation };
}

export function RampEditor({ control, describedBy }: EditorProps<RampControl>) {
  const ramp = useRamp(control);
  const step = useStep();
  const [chosen, setChosen] = useState(0);
  const [curveOf, setCurveOf] = useState("all");
  const { parts, label } = control;
  const selected = Math.min(chosen, ramp.knots.length - 1);

  const change = ({ knots, colors }: Ramp): void =>
    setValues({ [parts.knots]: knots, [parts.colors]: colors }, step.name());
  const remove = (index: number): void => {
    // The focus would vanish with the deleted key, so it moves to the neighbour.
    const next = Math.max(index - 1, 0);
    const focused = document.activeElement;
    const fromKey = focused instanceof HTMLElement && focused.matches("[role=slider]") ? focused.parentElement : null;
    change(deleteKey(ramp, index));
    setChosen(next);
    if (fromKey) {
      window.setTimeout(() => fromKey.querySelectorAll<HTMLElement>(":scope > [role=slider]")[next]?.focus());
    }
  };

  if (ramp.knots.length === 0) {
    return (
      <Button
        size="compact-xs"
        variant="default"
        aria-describedby={describedBy}
        onClick={() => {
          setValues({
            [parts.knots]: [0, 1],
            [parts.colors]: [
              [1, 1, 1],
              [1, 1, 1],
            ],
          });
        }}
      >
        Add a ramp
      </Button>
    );
  }

  const part: PartProps = { ramp, label, selected, step, select: setChosen, change, remove };
  const { channel, name } = CHANNELS.find(({ value }) => value === curveOf) ?? CHANNELS[0]!;
  return (
    <div className={styles.editor}>
      <GradientBar {...part} />
      <CurveView {...part} channel={channel} channelName={name} />
      <div className={styles.details}>
        <span className={styles.which}>
          Key {selected + 1} of {ramp.knots.length} at
        </span>
        <NumberField
          className={styles.position}
          label={`${label}, position of key ${selected + 1}`}
          step={0.01}
          digits={4}
          value={ramp.knots[selected]!}
          onChange={(place) => change(moveKey(ramp, selected, place))}
        />
        <div className={styles.color}>
          <ColorButton
            label={`${label}, colour of key ${selected + 1}`}
            color={ramp.colors[selected]!}
            step={step}
            onChange={(color) => change(paintKey(ramp, selected, color))}
          />
        </div>
        <ActionIcon
          size="sm"
          variant="subtle"
          color="gray"
          aria-label={`Delete key ${selected + 1}`}
          title="Delete this key (Del)"
          onClick={() => remove(selected)}
        >
          <DeleteIcon />
        </ActionIcon>
      </div>
      <div className={styles.details}>
        <SegmentedControl
          size="xs"
          aria-label={`${label}, curve that is edited`}
          value={curveOf}
          onChange={setCurveOf}
          data={CHANNELS.map(({ value, label: text }) => ({ value, label: text }))}
        />
        <NativeSelect
          size="xs"
          className={styles.interpolation}
          aria-label={`${label}, interpolation`}
          title="Interpolation"
          aria-describedby={describedBy}
          value={ramp.interpolation}
          data={control.choices ?? [ramp.interpolation]}
          onChange={(event) => setValues({ [parts.interpolation]: event.currentTarget.value })}
        />
        <Button
          size="compact-xs"
          variant="default"
          onClick={() => {
            const added = addKey(ramp, widestGap(ramp.knots));
            setChosen(added.index);
            change(added.ramp);
          }}
        >
          Add key
        </Button>
      </div>
    </div>
  );
}
