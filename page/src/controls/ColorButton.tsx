/** A swatch with the colour's code; pressed, it opens the picker. Used for colours and for the keys of ramps. */

import { ColorPicker, Input, Popover, Slider } from "@mantine/core";
import { useState } from "react";
import { hex, parseHex, scaled, splitIntensity } from "../common/color";
import { NumberField } from "../common/NumberField";
import { format } from "../common/numbers";
import { ownUndo } from "../keep/shortcuts";
import type { Triple } from "../protocol";
import styles from "./controls.module.css";
import type { Step } from "./step";

interface ColorProps {
  label: string;
  color: Triple;
  step: Step;
  onChange: (color: Triple) => void;
}

function HexField({ color, onChange }: Pick<ColorProps, "color" | "onChange">) {
  const [draft, setDraft] = useState<string | null>(null);
  const { base, intensity } = splitIntensity(color);
  const confirm = (): void => {
    const typed = draft === null ? null : parseHex(draft);
    if (typed) onChange(scaled(typed, intensity));
    setDraft(null);
  };
  return (
    <Input
      size="xs"
      aria-label="sRGB code"
      error={draft !== null && parseHex(draft) === null}
      value={draft ?? hex(base)}
      onChange={(event) => setDraft(event.currentTarget.value)}
      onBlur={confirm}
      onKeyDown={(event) => {
        if (event.key === "Enter") confirm();
      }}
      {...ownUndo(draft !== null)}
    />
  );
}

function Picker({ color, step, onChange }: Omit<ColorProps, "label">) {
  const { base, intensity } = splitIntensity(color);
  return (
    <div className={styles.picker}>
      <div onPointerDown={step.hold} onPointerUp={step.release}>
        <ColorPicker
          size="sm"
          fullWidth
          format="hex"
          saturationLabel="Saturation and brightness"
          hueLabel="Hue"
          value={hex(base)}
          onChange={(code) => {
            const picked = parseHex(code);
            // The picker has 8 bits per channel; if it only repeats the colour it must not round it.
            if (picked && code !== hex(base)) onChange(scaled(picked, intensity));
          }}
        />
      </div>
      <div className={styles.pickerRow}>
        <span>Intensity</span>
        <Slider
          size="xs"
          min={1}
          max={20}
          step={0.1}
          label={null}
          thumbLabel="Intensity"
          value={Math.min(intensity, 20)}
          onPointerDown={step.hold}
          onChangeEnd={step.release}
          onChange={(value) => onChange(scaled(base, value))}
        />
        <NumberField
          label="Intensity, exact"
          min={0}
          value={intensity}
          onChange={(value) => onChange(scaled(base, value))}
        />
      </div>
      <div className={styles.pickerRow}>
        <span>sRGB</span>
        <HexField color={color} onChange={onChange} />
      </div>
      <div className={styles.pickerChannels}>
        <span>Linear</span>
        {["Red", "Green", "Blue"].map((name, index) => (
          <NumberField
            key={name}
            label={`${name}, linear`}
            min={0}
            step={0.01}
            digits={3}
            value={color[index] ?? 0}
            onChange={(value) => onChange(color.map((old, i) => (i === index ? value : old)) as Triple)}
          />
        ))}
      </div>
    </div>
  );
}

export function ColorButton({ label, color, step, onChange, describedBy }: ColorProps & { describedBy?: string }) {
  const { base, intensity } = splitIntensity(color);
  const code = hex(base);
  return (
    <Popover trapFocus position="bottom-end" shadow="md" width={264} withinPortal>
      <Popover.Target>
        <button
          type="button"
          className={styles.colorButton}
          aria-label={`${label}: ${code}${intensity > 1 ? ` × ${format(intensity, 3)}` : ""}`}
          aria-describedby={describedBy}
        >
          <span className={styles.swatch} style={{ background: code }} />
          <span>{code}</span>
          {intensity > 1 && <span className={styles.intensity}>× {format(intensity, 3)}</span>}
        </button>
      </Popover.Target>
      <Popover.Dropdown aria-label={label}>
        <Picker color={color} step={step} onChange={onChange} />
      </Popover.Dropdown>
    </Popover>
  );
}
