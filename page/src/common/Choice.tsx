/** A choice among a few, with a name that is read aloud and shown as a tip. */

import { NativeSelect } from "@mantine/core";

interface ChoiceProps {
  label: string;
  value: string;
  data: (string | { value: string; label: string })[];
  onChange: (value: string) => void;
  className?: string;
}

export function Choice({ label, onChange, ...rest }: ChoiceProps) {
  return (
    <NativeSelect
      size="xs"
      aria-label={label}
      title={label}
      onChange={(event) => onChange(event.currentTarget.value)}
      {...rest}
    />
  );
}
