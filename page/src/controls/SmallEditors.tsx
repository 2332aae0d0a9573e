/** Editors for the kinds of values that need only one field. */

import { Autocomplete, Input, MultiSelect, NativeSelect, Switch } from "@mantine/core";
import { useState } from "react";
import { format, lastName, parse } from "../common/numbers";
import { ownUndo } from "../keep/shortcuts";
import { setValues } from "../session/session";
import { type EditorProps, spokenLabel, useProblem, useValue } from "./attribute";
import styles from "./controls.module.css";

export function BoolEditor({ control, describedBy }: EditorProps) {
  const value = useValue(control.path);
  return (
    <Switch
      size="xs"
      aria-label={control.label}
      aria-describedby={describedBy}
      checked={value === true}
      onChange={(event) => setValues({ [control.path]: event.currentTarget.checked })}
    />
  );
}

export function ChoiceEditor({ control, describedBy }: EditorProps) {
  const value = String(useValue(control.path) ?? "");
  const choices = control.choices ?? [];
  return (
    <NativeSelect
      size="xs"
      aria-label={control.label}
      aria-describedby={describedBy}
      value={value}
      // A value that is none of the choices is listed, too.
      data={choices.includes(value) ? choices : [value, ...choices]}
      onChange={(event) => setValues({ [control.path]: event.currentTarget.value })}
    />
  );
}

/** A field whose text becomes the value by Enter or by leaving it, if `read` finds a value in it. */
function ConfirmedText({ control, describedBy, text, read }: ConfirmedTextProps) {
  const problem = useProblem(control);
  const [draft, setDraft] = useState<string | null>(null);
  const confirm = (typed = draft): void => {
    const value = typed === null || typed === text ? null : read(typed);
    if (value !== null) setValues({ [control.path]: value });
    setDraft(null);
  };
  const shared = {
    size: "xs",
    spellCheck: false,
    "aria-label": spokenLabel(control),
    "aria-describedby": describedBy,
    error: problem !== null || (draft !== null && read(draft) === null),
    value: draft ?? text,
    onBlur: () => confirm(),
    onKeyDown: (event: React.KeyboardEvent): void => {
      if (event.key === "Enter") confirm();
      else if (event.key === "Escape") setDraft(null);
    },
    ...ownUndo(draft !== null),
  };
  if (control.choices.length === 0) {
    return <Input {...shared} onChange={(event) => setDraft(event.currentTarget.value)} />;
  }
  return (
    <Autocomplete
      {...shared}
      placeholder={control.kind === "asset" ? "file" : undefined}
      data={[...new Set(control.choices)]}
      // All are offered until something is typed: whoever opens the list wants another one.
      filter={draft === null ? ({ options }) => options : undefined}
      maxDropdownHeight={240}
      onChange={setDraft}
      onOptionSubmit={(chosen) => confirm(chosen)}
    />
  );
}

interface ConfirmedTextProps extends EditorProps {
  text: string;
  read: (text: string) => string | number[] | null;
}

export function TextEditor(props: EditorProps) {
  const value = useValue(props.control.path);
  return <ConfirmedText {...props} text={typeof value === "string" ? value : ""} read={(text) => text} />;
}

/** Numbers are separated by blanks or by commas, so a comma is no decimal point here. */
function readNumbers(text: string): number[] | null {
  const numbers = text
    .split(/[\s,;]+/)
    .filter(Boolean)
    .map(parse);
  return numbers.every((number) => number !== null) ? numbers : null;
}

export function NumbersEditor(props: EditorProps) {
  const value = useValue(props.control.path);
  const numbers = Array.isArray(value) ? (value as number[]) : [];
  return <ConfirmedText {...props} text={numbers.map((number) => format(number)).join(", ")} read={readNumbers} />;
}

export function PathsEditor({ control, describedBy }: EditorProps) {
  const value = useValue(control.path);
  const chosen = Array.isArray(value) ? (value as string[]) : [];
  const choices = [...new Set([...(control.choices ?? []), ...chosen])];
  const names = choices.map(lastName);
  const isUnique = (name: string): boolean => names.indexOf(name) === names.lastIndexOf(name);
  return (
    <MultiSelect
      size="xs"
      aria-label={control.label}
      aria-describedby={describedBy}
      className={styles.paths}
      placeholder={chosen.length === 0 ? "none" : undefined}
      data={choices.map((path) => ({ value: path, label: isUnique(lastName(path)) ? lastName(path) : path }))}
      nothingFoundMessage="no such object"
      maxDropdownHeight={240}
      value={chosen}
      searchable
      onChange={(paths) => setValues({ [control.path]: paths })}
    />
  );
}
