/** A ramp's channels as curves, with knots that are dragged in place and value. */

import { type KeyboardEvent, type PointerEvent, useRef, useState } from "react";
import { format } from "../common/numbers";
import type { Triple } from "../protocol";
import { rampCurve } from "./interpolate";
import { addKey, type Channel, channelValue, domain, moveKey, setKeyValue } from "./keys";
import { onKeyOfKey, type PartProps, placeOf, places } from "./part";
import styles from "./ramp.module.css";

/** A round number that no curve exceeds. */
function ceiling(colors: Triple[]): number {
  const most = Math.max(1, ...colors.flat());
  const power = 10 ** Math.floor(Math.log10(most));
  return [1, 1.5, 2, 3, 4, 5, 6, 8, 10].map((factor) => factor * power).find((top) => top >= most * 0.999) ?? most;
}

export function CurveView(props: PartProps & { channel: Channel; channelName: string }) {
  const { ramp, label, selected, step, select, change, channel, channelName } = props;
  const field = useRef<HTMLDivElement>(null);
  // The scale must not change under the pointer, so it is held until the end of a drag.
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
    // Above the field, values keep growing: light has no upper limit.
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
