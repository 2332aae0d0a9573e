/** Numbers as people read and write them. */

/** A number rounded to `digits`: 0.1, stored with 32 bits, comes back as 0.10000000149. */
export function format(value: number, digits = 6): string {
  if (!Number.isFinite(value)) return String(value);
  return String(Number(value.toPrecision(digits)));
}

/** The number in a text, with a comma for a decimal point too; null for anything else. */
export function parse(text: string): number | null {
  const trimmed = text.trim().replace(",", ".");
  const value = Number(trimmed);
  return trimmed !== "" && Number.isFinite(value) ? value : null;
}

/** A step for arrow keys and sliders: the power of ten that divides a range into a hundred parts or more. */
export function stepFor(range: number): number {
  return 10 ** Math.floor(Math.log10(Math.max(range, 1e-6) / 100));
}

export function clampTo(value: number, min: number | null, max: number | null): number {
  return Math.min(Math.max(value, min ?? -Infinity), max ?? Infinity);
}

/** The last name of a prim's path. */
export function lastName(path: string): string {
  return path.slice(path.lastIndexOf("/") + 1);
}

/** Seconds as people say them: 42 s, 3 min 20 s, 25 min, 1.5 h. */
export function duration(seconds: number): string {
  if (seconds < 90) return `${Math.max(Math.round(seconds), 1)} s`;
  if (seconds >= 5400) return `${(seconds / 3600).toFixed(1)} h`;
  const tens = Math.round(seconds / 10);
  const rest = seconds < 600 && tens % 6 !== 0 ? ` ${10 * (tens % 6)} s` : "";
  return `${seconds < 600 ? Math.floor(tens / 6) : Math.round(seconds / 60)} min${rest}`;
}

/** An amount of memory: 850 MB, 1.2 GB. */
export function bytes(count: number): string {
  return count < 1e9 ? `${Math.ceil(count / 1e7) * 10} MB` : `${(count / 1e9).toFixed(count < 1e10 ? 1 : 0)} GB`;
}
