/** The messages between page and server, as types. */

export type Triple = [number, number, number];

export interface RampValue {
  knots: number[];
  colors: Triple[];
  interpolation: string;
}

export type Value = null | boolean | number | string | number[] | string[] | number[][] | RampValue;
export type Values = Record<string, Value>;

interface ControlBase {
  path: string;
  label: string;
  section: string;
  authored: boolean;
  doc: string;
  unit: string;
  value: Value;
  default: Value;
  min: number | null;
  max: number | null;
  soft: [number, number] | null;
  choices: string[] | null;
}

export interface PlainControl extends ControlBase {
  kind: "number" | "integer" | "bool" | "color" | "choice" | "text" | "expression" | "numbers" | "paths" | "asset";
}

/** A ramp is edited as one thing, but stored as three attributes. */
export interface RampControl extends ControlBase {
  kind: "ramp";
  parts: { knots: string; colors: string; interpolation: string };
}

export type Control = PlainControl | RampControl;

export interface ControlGroup {
  path: string;
  kind: "light" | "medium" | "look";
  label: string;
  type: string;
  controls: Control[];
  uses?: string[];
  soloed?: boolean;
}

/** A look to start from, or a factor of one. */
export interface Preset {
  name: string;
  label: string;
  /** "look" for a whole look, else the section of a look's controls in small letters. */
  factor: string;
}

/** How a camera becomes two eyes: their distance, and the distance where they converge; null: the usual one. */
export type Stereo = [interaxial: number | null, convergence: number | null];

export type Eye = "anaglyph" | "side-by-side" | "left" | "right";

/** A camera-to-world matrix: 16 numbers, row by row, for column vectors; it looks along −z with +y up. */
export type Pose = number[];

export interface Scene {
  type: "scene";
  name: string;
  cameras: string[];
  frames: [number, number] | null;
  fps: number;
  layers: string[];
  displays: string[];
  controls: ControlGroup[];
  pose: Pose | null;
  /** The focal length in widths of the picture. */
  focal: number;
  up: "Y" | "Z";
  stereo: Stereo | null;
  /** Whether the camera is one of a pair of eyes on the stage, which cannot be moved apart. */
  pair: boolean;
  /** The usual distance of eyes. */
  interaxial: number;
  presets: Preset[];
}

export interface ValuesMessage {
  type: "values";
  values: Values;
  authored: Record<string, boolean>;
  canUndo: boolean;
  canRedo: boolean;
  saved: boolean;
  /** Whether there are edits that an earlier studio did not save. */
  restored: boolean;
}

/** A preset was applied for this page. */
export interface Applied {
  type: "applied";
  path: string;
  look: string;
}

export interface Problem {
  text: string;
  path: string | null;
  column: number | null;
}

export interface RenderState {
  type: "state";
  version: number;
  passes: number;
  planned: number;
  seconds: number;
  busy: boolean;
  problem: Problem | null;
}

/** What one kind of quadrature gives for each number of points in `n`. */
export interface RuleCurves {
  n: number[];
  points: number[][];
  values: number[][];
  error: number[];
}

export interface Ray {
  estimator: "1D" | "2D";
  interval: [number, number];
  radius: [number, number];
  length: number;
  s: number[];
  integrand: number[];
  gauss: RuleCurves;
  riemann: RuleCurves;
}

export interface BeamShare {
  light: string;
  group: string;
  radiance: Triple;
  share: number;
}

export interface Pixel {
  type: "pixel";
  at: [number, number];
  layers: Record<string, number[]>;
  beams: BeamShare[];
  ray: Ray | null;
}

export interface RenderProgress {
  type: "render";
  done: number;
  of: number;
  file: string | null;
  problem: string | Problem | null;
}

export interface Refused {
  type: "refused";
  text: string;
}

export type ServerMessage = Scene | ValuesMessage | RenderState | Pixel | RenderProgress | Applied | Refused;

export type Area = [x0: number, y0: number, x1: number, y1: number];

/** What the page asks the server to draw. */
export interface Show {
  size: [number, number];
  camera: string;
  pose: Pose | null;
  frame: number;
  layer: string;
  exposure: number;
  display: string;
  area: Area | null;
  lens: boolean;
  blur: boolean;
  denoise: boolean;
  stereo: Stereo | null;
  eye: Eye;
  solo: string[];
  paused: boolean;
}

export type PageMessage =
  | { type: "set"; values: Values; step: string | null }
  | { type: "apply"; preset: string; path: string }
  | { type: "undo" | "redo" | "revert" | "discard" | "save" | "cancel" }
  | ({ type: "show" } & Partial<Show>)
  | { type: "inspect"; at: [number, number] }
  | { type: "render"; passes: number; frames: [number, number] | null };

export interface PictureHeader {
  version: number;
  passes: number;
  planned: number;
  width: number;
  height: number;
  layer: string;
  /** Below 1: a preview at reduced resolution, to be drawn as large as the full picture. */
  scale: number;
  mime: string;
}

/** Split a binary message into its header and the encoded picture. */
export function readPicture(message: ArrayBuffer): { header: PictureHeader; picture: Blob } {
  const length = new DataView(message).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(message, 4, length))) as PictureHeader;
  return { header, picture: new Blob([new Uint8Array(message, 4 + length)], { type: header.mime }) };
}
