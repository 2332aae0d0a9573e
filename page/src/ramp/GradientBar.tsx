/** A ramp as a gradient, with its keys below: click to add one, drag to move it. */

import { type PointerEvent, useRef } from "react";
import { hex } from "../common/color";
import { format } from "../common/numbers";
import { rampCurve } from "./interpolate";
import { addKey, domain, moveKey } from "./keys";
import { onKeyOfKey, type PartProps, placeOf, places } from "./part";
import styles from "./ramp.module.css";

export function GradientBar(props: PartProps) {
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
