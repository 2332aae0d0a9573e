/** The editor of a ramp: its gradient with the keys, its curves, and the details of the chosen key. */

import { ActionIcon, Button, NativeSelect, SegmentedControl } from "@mantine/core";
import { type KeyboardEvent, type PointerEvent, useRef, useState } from "react";
import { hex } from "../common/color";
import { DeleteIcon } from "../common/icons";
import { NumberField } from "../common/NumberField";
import { format } from "../common/numbers";
import { type EditorProps, useValue } from "../controls/attribute";
import { ColorButton } from "../controls/ColorButton";
import { type Step, useStep } from "../controls/step";
import type { RampControl, Triple } from "../protocol";
import { setValues } from "../session/session";
import { type Ramp, rampCurve } from "./interpolate";
import {
  addKey,
  type Channel,
  channelValue,
  deleteKey,
  domain,
  moveKey,
  paintKey,
  setKeyValue,
  widestGap,
} from "./keys";
import styles from "./ramp.module.css";

const SAMPLES = 96;
const CHANNELS: { value: string; label: string; name: string; channel: Channel }[] = [
  { value: "all", label: "All", name: "brightness", channel: "luminance" },
  { value: "red", label: "R", name: "red", channel: 0 },
  { value: "green", label: "G", name: "green", channel: 1 },
  { value: "blue", label: "B", name: "blue", channel: 2 },
];

interface PartProps {
  ramp: Ramp;
  label: string;
  selected: number;
  step: Step;
  select: (index: number) => void;
  change: (ramp: Ramp) => void;
  remove: (index: number) => void;
}

function useRamp({ parts }: RampControl): Ramp {
  const knots = (useValue(parts.knots) ?? []) as number[];
  const colors = (useValue(parts.colors) ?? []) as Triple[];
  const interpolation = String(useValue(parts.interpolation) ?? "linear");
  // While a message has changed only one of the two, their lengths may differ.
  const count = Math.min(knots.length, colors.length);
  return { knots: knots.slice(0, count), colors: colors.slice(0, count), interpolation };
}

/** Places along the ramp at which it is drawn; steps need both sides of each knot. */
function places({ knots, interpolation }: Ramp): number[] {
  const [first, last] = domain(knots);
  const even = Array.from({ length: SAMPLES + 1 }, (_, i) => first + ((last - first) * i) / SAMPLES);
  const sides = interpolation === "none" ? knots.flatMap((knot) => [knot - 1e-6, knot]) : knots;
  return [...even, ...sides].sort((a, b) => a - b);
}

/** Where a pointer is along an element, as a place along the ramp. */
function placeOf(event: { clientX: number }, element: Element, [first, last]: [number, number]): number {
  const { left, width } = element.getBoundingClientRect();
  return first + ((last - first) * Math.min(Math.max(event.clientX - left, 0), width)) / width;
}

/** Handles a key's movement along the ramp, and its deletion, by the keyboard. */
function onKeyOfKey(event: KeyboardEvent, index: number, { ramp, change, remove, select }: PartProps): void {
  const [first, last] = domain(ramp.knots);
  const size = (last - first) * (event.shiftKey ? 0.1 : 0.01);
  const direction = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (direction !== undefined) {
    event.preventDefault();
    select(index);
    change(moveKey(ramp, index, ramp.knots[index]! + direction * size));
  } else if (event.key === "Delete" || event.key === "Backspace") {
    event.preventDefault();
    remove(index);
  }
}

function GradientBar(props: PartProps) {
  const { ramp, label, selected, step, select, change } = props;
  const bar = useRef<HTMLDivElement>(null);
  const range = domain(ramp.knots);
  const [first, last] = range;
  const percent = (place: number): number => (100 * (place - first)) / (last - first);
  const curve = rampCurve(ramp);
  const stops = places(ramp).map((place) => `${hex(curve(place))} ${percent(place).toFixed(2)}%`);

  const onPointerDown = (event: PointerEvent<HTMLDivElement>): void => {
    if (event.button !== 0) return;
    const added = addKey(ramp, placeOf(event, event.currentTarget, range));
    select(added.index);
    change(added.ramp);
  };
  const drag = (event: PointerEvent, index: number): void => {
    if (event.buttons === 0 || !bar.current) return;
    change(moveKey(ramp, index, placeOf(event, bar.current, range)));
  };
  return (
    <div className={styles.gradientPlace}>
      <div
        ref={bar}
        className={styles.gradient}
        title="Click to add a key"
        style={{ background: `linear-gradient(90deg, ${stops.join(", ")})` }}
        onPointerDown={onPointerDown}
      />
      {ramp.knots.map((knot, index) => (
        <div
          // Keys keep their order, so the index is their name while one is dragged.
          key={index}
          className={styles.key}
          data-selected={index === selected}
          style={{ left: `${percent(knot)}%`, background: hex(ramp.colors[index]!) }}
          role="slider"
          tabIndex={0}
          aria-label={`${label}, key ${index + 1} of ${ramp.knots.length}, position`}
          aria-valuemin={first}
          aria-valuemax={last}
          aria-valuenow={Number(format(knot, 4))}
          onFocus={() => select(index)}
          onPointerDown={(event) => {
            event.currentTarget.setPointerCapture(event.pointerId);
            step.hold();
          }}
          onPointerMove={(event) => drag(event, index)}
          onPointerUp={step.release}
          onPointerCancel={step.release}
          onKeyDown={(event) => onKeyOfKey(event, index, props)}
        />
      ))}
    </div>
  );
}

/** A round number that no curve exceeds. */
function ceiling(colors: Triple[]): number {
  const most = Math.max(1, ...colors.flat());
  const power = 10 ** Math.floor(Math.log10(most));
  return [1, 1.5, 2, 3, 4, 5, 6, 8, 10].map((factor) => factor * power).find((top) => top >= most * 0.999) ?? most;
}

function CurveView(props: PartProps & { channel: Channel; channelName: string }) {
  const { ramp, label, selected, step, select, change, channel, channelName } = props;
  const field = useRef<HTMLDivElement>(null);
  // The scale must not change under the pointer, so it waits for the end of a drag.
  const [heldTop, setHeldTop] = useState<number | null>(null);
  const top = heldTop ?? ceiling(ramp.colors);
  const range = domain(ramp.knots);
  const [first, last] = range;
  const percent = (place: number): number => (100 * (place - first)) / (last - first);
  const height = (value: number): number => 100 * (1 - value / top);

  const curve = rampCurve(ramp);
  const samples = places(ramp).map((place) => ({ x: percent(place), color: curve(place) }));
  const line = (of: Channel): string =>
    samples.map(({ x, color }) => `${x.toFixed(2)},${height(channelValue(color, of)).toFixed(2)}`).join(" ");

  const drag = (event: PointerEvent, index: number): void => {
    const bounds = field.current?.getBoundingClientRect();
    if (event.buttons === 0 || !bounds) return;
    const moved = moveKey(ramp, index, placeOf(event, field.current!, range));
    // Beyond the top, values go on growing: light has no upper end.
    const value = top * (1 - (event.clientY - bounds.top) / bounds.height);
    change(setKeyValue(moved, index, channel, value));
  };
  const letGo = (): void => {
    step.release();
    setHeldTop(null);
  };
  const onKeyDown = (event: KeyboardEvent, index: number): void => {
    const direction = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (direction === undefined) return onKeyOfKey(event, index, props);
    event.preventDefault();
    select(index);
    const size = top * (event.shiftKey ? 0.1 : 0.01);
    change(setKeyValue(ramp, index, channel, channelValue(ramp.colors[index]!, channel) + direction * size));
  };

  return (
    <div className={styles.curve}>
      <span className={styles.top}>{format(top, 3)}</span>
      <span className={styles.bottom}>0</span>
      <div
        ref={field}
        className={styles.field}
        title="Double-click to add a key"
        onDoubleClick={(event) => {
          if (event.target instanceof Element && event.target.closest("[role=slider]")) return;
          const added = addKey(ramp, placeOf(event, event.currentTarget, range));
          select(added.index);
          change(added.ramp);
        }}
      >
        <svg className={styles.lines} viewBox="0 0 100 100" preserveAspectRatio="none" aria-hidden>
          {[25, 50, 75].map((place) => (
            <path key={place} className={styles.grid} d={`M0 ${place}H100M${place} 0V100`} />
          ))}
          <polyline className={styles.red} data-active={channel === 0} points={line(0)} />
          <polyline className={styles.green} data-active={channel === 1} points={line(1)} />
          <polyline className={styles.blue} data-active={channel === 2} points={line(2)} />
          <polyline className={styles.white} data-active={channel === "luminance"} points={line("luminance")} />
        </svg>
        {ramp.knots.map((knot, index) => {
          const value = channelValue(ramp.colors[index]!, channel);
          return (
            <div
              key={index}
              className={styles.knot}
              data-selected={index === selected}
              style={{ left: `${percent(knot)}%`, top: `${Math.max(height(value), 0)}%` }}
              role="slider"
              tabIndex={0}
              aria-orientation="vertical"
              aria-label={`${label}, key ${index + 1} of ${ramp.knots.length}, ${channelName}`}
              aria-valuemin={0}
              aria-valuemax={Math.max(top, value)}
              aria-valuenow={Number(format(value, 4))}
              aria-valuetext={`${format(value, 4)} at ${format(knot, 4)}`}
              onFocus={() => select(index)}
              onPointerDown={(event) => {
                event.currentTarget.setPointerCapture(event.pointerId);
                setHeldTop(top);
                step.hold();
              }}
              onPointerMove={(event) => drag(event, index)}
              onPointerUp={letGo}
              onPointerCancel={letGo}
              onKeyDown={(event) => onKeyDown(event, index)}
            />
          );
        })}
      </div>
    </div>
  );
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
    // The deleted key takes the focus with it; its neighbour is the place to go on.
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
