/** Linear colours and their appearance on the screen. */

import type { Triple } from "../protocol";

export function toDisplay(linear: number): number {
  const x = Math.min(Math.max(linear, 0), 1);
  return x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
}

export function toLinear(display: number): number {
  return display <= 0.04045 ? display / 12.92 : ((display + 0.055) / 1.055) ** 2.4;
}

/** A linear colour as sRGB, #rrggbb; each channel above 1 is cut off. */
export function hex(color: readonly number[]): string {
  const bytes = [0, 1, 2].map((channel) => Math.round(255 * toDisplay(color[channel] ?? 0)));
  return `#${bytes.map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
}

/** The linear colour of #rrggbb or #rgb; null for anything else. */
export function parseHex(text: string): Triple | null {
  const digits = /^#?([0-9a-f]{3}|[0-9a-f]{6})$/i.exec(text.trim())?.[1];
  if (!digits) return null;
  const size = digits.length / 3;
  const channel = (index: number): number => {
    const part = digits.slice(index * size, (index + 1) * size);
    return toLinear(Number.parseInt(size === 1 ? part + part : part, 16) / 255);
  };
  return [channel(0), channel(1), channel(2)];
}

export function luminance(color: readonly number[]): number {
  return 0.2126 * (color[0] ?? 0) + 0.7152 * (color[1] ?? 0) + 0.0722 * (color[2] ?? 0);
}

/** A colour as a base from 0 to 1 and a factor of 1 or more: the picker cannot show values above 1. */
export function splitIntensity(color: readonly number[]): { base: Triple; intensity: number } {
  const intensity = Math.max(1, ...color);
  return { base: [0, 1, 2].map((i) => (color[i] ?? 0) / intensity) as Triple, intensity };
}

export function scaled(color: readonly number[], factor: number): Triple {
  return [0, 1, 2].map((i) => (color[i] ?? 0) * factor) as Triple;
}
