/** The messages between page and server, as types. Written by tools/protocol.py: do not edit. */

export type Triple = [number, number, number];

export type Eyes = [number | null, number | null];

export type Area = [number, number, number, number];

/** A value that can be edited, as in JSON. */
export type Value = null | boolean | number | string | number[] | string[] | number[][] | Ramp;

export type Values = Record<string, Value>;

/** Set values by their paths; None leaves one to the stage. Edits in a row with one `step` are undone together. */
export interface Set {
  type: "set";
  values: Values;
  step?: string | null;
}

/** Apply a preset to the look at a path, or give the light at a path a new look with it. */
export interface Apply {
  type: "apply";
  preset: string;
  path: string;
}

/** Keep the look at a path in the library, for other shots. */
export interface Keep {
  type: "keep";
  path: string;
}

/** Undo the last step. */
export interface Undo {
  type: "undo";
}

/** Redo the step that was undone last. */
export interface Redo {
  type: "redo";
}

/** Remove all edits. */
export interface Revert {
  type: "revert";
}

/** Go back to the edits that were saved last. */
export interface Discard {
  type: "discard";
}

/** Write the edits to their file; if another program has changed it, ask, merge, or write a copy beside it. */
export interface Save {
  type: "save";
  changed?: "ask" | "merge" | "copy";
}

/**
 * Change what is shown: the view, which all pages share, and this page's layer, eye, exposure and view transform.
 *
 * `stereo` holds the distance between the eyes and the distance at which they converge; each may be None: see
 * `usd.cameras.stereo.Stereo`. `eye` is "anaglyph", "side-by-side", "left" or "right". `other` is a layer whose
 * picture comes before that of `layer`, to be compared with it; None: none.
 */
export interface Show {
  type: "show";
  size?: [number, number];
  camera?: string | null;
  pose?: number[] | null;
  frame?: number | null;
  area?: Area | null;
  lens?: boolean;
  blur?: boolean;
  denoise?: boolean;
  bounces?: number | null;
  stereo?: Eyes | null;
  solo?: string[];
  paused?: boolean;
  eye?: string;
  layer?: string;
  other?: string | null;
  exposure?: number;
  display?: string;
}

/** Ask what is in the pixel at a place, in fractions of the picture from the top left. */
export interface Inspect {
  type: "inspect";
  at: [number, number];
}

/**
 * Render the final picture, or those from the first to the last of `frames`.
 *
 * `size` is its width and height, None: as shown; `file` is where it is written, from the stage's folder, None: it is
 * only handed out.
 */
export interface Render {
  type: "render";
  passes: number;
  frames?: [number, number] | null;
  size?: [number, number] | null;
  denoise?: boolean;
  file?: string | null;
}

/** Estimate what that final render takes; the answer has the same `number`. A page's next one replaces it. */
export interface Estimate {
  type: "estimate";
  number: number;
  passes: number;
  frames?: [number, number] | null;
  size?: [number, number] | null;
  denoise?: boolean;
}

/** End the final render, or the estimate of one. */
export interface Cancel {
  type: "cancel";
  estimate?: boolean;
}

/** The value of a ramp; it is stored as three attributes, whose paths are the `parts` of its control. */
export interface Ramp {
  knots: number[];
  colors: Triple[];
  interpolation: string;
}

/** A value that can be edited: see `usd.authoring.controls.Control`. Without what it `needs` it has no effect. */
export interface ControlItem {
  path: string;
  label: string;
  section: string;
  kind: "number" | "integer" | "bool" | "color" | "choice" | "text" | "expression" | "numbers" | "paths" | "asset" | "ramp";
  value: Value;
  default: Value;
  authored: boolean;
  min: number | null;
  max: number | null;
  soft: [number, number] | null;
  choices: string[];
  unit: string;
  doc: string;
  parts: Record<string, string>;
  needs: Record<string, (boolean | string | null)[]>;
}

/** The controls of a prim, and the paths of the looks that it uses. */
export interface ControlGroup {
  path: string;
  kind: "light" | "medium" | "look";
  label: string;
  type: string;
  controls: ControlItem[];
  uses: string[];
}

/** A look to start from, or a factor of one: "look", or the section of its controls in small letters. */
export interface PresetItem {
  name: string;
  label: string;
  factor: string;
}

/**
 * What can be shown and edited. `focal` is the focal length in widths of the picture.
 *
 * `pose` is a camera-to-world matrix: 16 numbers, row by row, for column vectors; it looks along −z with +y up. With
 * `pair` the camera is one of a pair on the stage, which cannot be moved apart; `interaxial` is the usual distance.
 * `bounces` are those of the picture, and those that the stage or a room usually has.
 */
export interface SceneMessage {
  type: "scene";
  name: string;
  cameras: string[];
  frames: [number, number] | null;
  fps: number;
  layers: string[];
  displays: string[];
  controls: ControlGroup[];
  pose: number[] | null;
  focal: number;
  up: "Y" | "Z";
  stereo: Eyes | null;
  pair: boolean;
  interaxial: number;
  bounces: [number, number];
  presets: PresetItem[];
}

/** Values that changed; `restored` edits are those that an earlier studio did not save. */
export interface ValuesMessage {
  type: "values";
  values: Values;
  authored: Record<string, boolean>;
  canUndo: boolean;
  canRedo: boolean;
  saved: boolean;
  restored: boolean;
}

/** Why there is no picture: the attribute, and the column of its text, if they are known. */
export interface ProblemText {
  text: string;
  path: string | null;
  column: number | null;
}

/** How far the picture is. */
export interface StateMessage {
  type: "state";
  version: number;
  passes: number;
  planned: number;
  seconds: number;
  busy: boolean;
  problem: ProblemText | null;
}

/** The radiance of a light's beams in a pixel, and its fraction of that of all beams. */
export interface BeamPart {
  light: string;
  group: string;
  radiance: Triple;
  fraction: number;
}

/** What one kind of quadrature gives for each number of points in `n`. */
export interface RuleCurves {
  n: number[];
  points: number[][];
  values: number[][];
  error: number[];
}

/** How the light of the brightest beam is integrated along a pixel's ray. */
export interface RayIntegral {
  estimator: "1D" | "2D";
  interval: [number, number];
  radius: [number, number];
  length: number;
  s: number[];
  integrand: number[];
  gauss: RuleCurves;
  riemann: RuleCurves;
}

/** What is in a pixel. */
export interface PixelMessage {
  type: "pixel";
  at: [number, number];
  layers: Record<string, number[]>;
  beams: BeamPart[];
  ray: RayIntegral | null;
}

/** How far the final picture is; then the address of its file, or the path where it was `written`. */
export interface RenderMessage {
  type: "render";
  done: number;
  of: number;
  file: string | null;
  written: string | null;
  problem: string | null;
}

/** About how long all frames take, in seconds, and how much memory, in bytes; or why that is not known. */
export interface EstimateMessage {
  type: "estimate";
  number: number;
  seconds: number | null;
  memory: number | null;
  problem: string | null;
}

/** A preset was applied for this page. */
export interface Applied {
  type: "applied";
  path: string;
  look: string;
}

/** The look at a path is in the library now, by a name. */
export interface Kept {
  type: "kept";
  path: string;
  label: string;
}

/** Another program has changed the file of the edits: they are in a copy now or, if that is None, not saved. */
export interface Changed {
  type: "changed";
  file: string;
  copy: string | null;
}

/** What a page asked for was refused. */
export interface Refused {
  type: "refused";
  text: string;
}

/**
 * What precedes a picture; with a `scale` below 1 it is a preview, to be drawn as large as the full picture.
 *
 * A `compared` one is the other layer of the picture that comes next.
 */
export interface PictureHeader {
  version: number;
  passes: number;
  planned: number;
  layer: string;
  width: number;
  height: number;
  scale: number;
  mime: string;
  frame?: number | null;
  compared?: boolean;
}

export type PageMessage = Set | Apply | Keep | Undo | Redo | Revert | Discard | Save | Show | Inspect | Render | Estimate | Cancel;

export type ServerMessage = SceneMessage | ValuesMessage | StateMessage | PixelMessage | RenderMessage | EstimateMessage | Applied | Kept | Changed | Refused;
