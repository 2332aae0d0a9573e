/** A field for one number: typed and confirmed by Enter or by leaving it, or stepped by the arrow keys. */

import { Input } from "@mantine/core";
import { type KeyboardEvent, useState } from "react";
import { ownUndo } from "../keep/shortcuts";
import { clampTo, format, parse } from "./numbers";

export interface NumberFieldProps {
  /** null: no number, which `none` names. */
  value: number | null;
  /** What is shown instead of a number if there is none, such as "auto"; an empty field goes back to that. */
  none?: string;
  onNone?: () => void;
  label: string;
  onChange: (value: number) => void;
  min?: number | null;
  max?: number | null;
  step?: number;
  integer?: boolean;
  describedBy?: string;
  invalid?: boolean;
  /** How many digits are shown; the value keeps all. */
  digits?: number;
  /** Whether the field gets the focus when its dialog opens. */
  first?: boolean;
  className?: string;
}

export function NumberField(props: NumberFieldProps) {
  const { value, label, onChange, min = null, max = null, integer = false, describedBy, invalid = false, digits = 6 } = props;
  const step = integer ? 1 : (props.step ?? 0.1);
  // The text while it is being typed; otherwise the field shows the value.
  const [draft, setDraft] = useState<string | null>(null);

  const isNone = (text: string): boolean => !!props.onNone && ["", props.none].includes(text.trim().toLowerCase());
  const commit = (number: number): void => {
    const next = clampTo(integer ? Math.round(number) : number, min, max);
    if (next !== value) onChange(next);
  };
  const confirm = (): void => {
    const typed = draft === null ? null : parse(draft);
    if (typed !== null) commit(typed);
    else if (draft !== null && isNone(draft) && value !== null) props.onNone?.();
    setDraft(null);
  };
  const onKeyDown = (event: KeyboardEvent): void => {
    const direction = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (event.key === "Enter") confirm();
    else if (event.key === "Escape" && draft !== null) {
      event.stopPropagation();
      setDraft(null);
    } else if (direction !== undefined) {
      event.preventDefault();
      const from = (draft === null ? null : parse(draft)) ?? value ?? min ?? 0;
      setDraft(null);
      const size = step * (event.shiftKey ? 10 : 1);
      // Rounded, so that 0.1 + 0.2 is 0.3.
      commit(Number((from + direction * size).toPrecision(12)));
    }
  };

  return (
    <Input
      size="xs"
      className={props.className}
      classNames={{ input: "numberInput" }}
      role="spinbutton"
      inputMode="decimal"
      aria-label={label}
      aria-valuenow={value ?? undefined}
      aria-valuetext={value === null ? props.none : undefined}
      placeholder={props.none}
      aria-valuemin={min ?? undefined}
      aria-valuemax={max ?? undefined}
      aria-describedby={describedBy}
      error={invalid || (draft !== null && parse(draft) === null && !isNone(draft))}
      value={draft ?? (value === null ? "" : integer ? String(value) : format(value, digits))}
      onChange={(event) => setDraft(event.currentTarget.value)}
      onFocus={(event) => event.currentTarget.select()}
      onBlur={confirm}
      onKeyDown={onKeyDown}
      data-autofocus={props.first}
      {...ownUndo(draft !== null)}
    />
  );
}
