/** The page's side of the session: its state, and everything that can be asked of the server. */

import type {
  Applied,
  Changed,
  ControlItem,
  Estimate,
  EstimateMessage,
  Kept,
  PageMessage,
  PixelMessage,
  Ramp,
  Render,
  RenderMessage,
  StateMessage,
  SceneMessage,
  ServerMessage,
  Show,
  Value,
  Values,
} from "../protocol";
import { Connection } from "./connection";
import { Edits } from "./edits";
import { Picture } from "./picture";
import { isRamp } from "./ramp";
import { Store } from "./store";
import { Throttle } from "./throttle";

/** How two eyes are shown, or which one. */
export type Eye = "anaglyph" | "side-by-side" | "left" | "right";

/** All that a page chooses to show; camera and frame are those of the first scene until they are chosen. */
export interface Shown extends Required<Omit<Show, "type">> {
  camera: string;
  frame: number;
  eye: Eye;
}

export interface SessionState {
  open: boolean;
  /** False until the first scene has come: before that, nothing was lost. */
  everOpen: boolean;
  retryAt: number | null;
  scene: SceneMessage | null;
  /** The value that the page shows for each attribute: the server's, or an edit that is on its way. */
  values: Values;
  authored: Record<string, boolean>;
  canUndo: boolean;
  canRedo: boolean;
  saved: boolean;
  restored: boolean;
  applied: Applied | null;
  /** The look that was kept in the library last. */
  kept: Kept | null;
  /** That another program has changed the file of the edits. */
  changed: Changed | null;
  state: StateMessage | null;
  pixel: PixelMessage | null;
  render: RenderMessage | null;
  /** What a final render with the dialog's settings takes; null while that is not known. */
  estimate: EstimateMessage | null;
  refused: string[];
  /** How many edits have come, also those of other pages. */
  edition: number;
  show: Shown;
}

const NOTHING_SHOWN: Shown = {
  size: [960, 540],
  camera: "",
  pose: null,
  frame: 0,
  layer: "",
  other: null,
  exposure: 0,
  display: "",
  area: null,
  lens: true,
  blur: true,
  denoise: true,
  bounces: null,
  stereo: null,
  eye: "left",
  solo: [],
  paused: false,
};

const NO_RAMP: Ramp = { knots: [], colors: [], interpolation: "linear" };

export const session = new Store<SessionState>({
  open: false,
  everOpen: false,
  retryAt: null,
  scene: null,
  values: {},
  authored: {},
  // Until the server says otherwise, there may be edits of an earlier page.
  canUndo: true,
  canRedo: true,
  saved: true,
  restored: false,
  applied: null,
  kept: null,
  changed: null,
  state: null,
  pixel: null,
  render: null,
  estimate: null,
  refused: [],
  edition: 0,
  show: NOTHING_SHOWN,
});

export const picture = new Picture();

let served: Values = {};
let servedAuthored: Record<string, boolean> = {};
let defaults: Values = {};
let cancelled = false;
/** The number of the estimate that is wanted. */
let estimate = 0;
/** Whether the server knows nothing yet of what this page shows. */
let unknown = true;
let unsentShow: Partial<Shown> = {};

const connection = new Connection({
  message: receive,
  picture: (message) => picture.receive(message),
  status: (open, retryAt) => {
    if (open) unknown = true;
    session.set({ open, retryAt });
  },
});
const post = (message: PageMessage): boolean => connection.send(message);
const edits = new Edits(post, mergeValues);
const showing = new Throttle(() => {
  if (Object.keys(unsentShow).length > 0 && post({ type: "show", ...unsentShow })) unsentShow = {};
});

/** The attributes of a control with what it says about each; a ramp has three. */
function attributes(control: ControlItem): [path: string, value: Value, fallback: Value][] {
  if (!isRamp(control)) return [[control.path, control.value, control.default]];
  const value = (control.value as Ramp | null) ?? NO_RAMP;
  const fallback = (control.default as Ramp | null) ?? NO_RAMP;
  return [
    [control.parts.knots, value.knots, fallback.knots],
    [control.parts.colors, value.colors, fallback.colors],
    [control.parts.interpolation, value.interpolation, fallback.interpolation],
  ];
}

/** Show edits on their way instead of the server's values, so that no answer to its beginning pulls a drag back. */
function mergeValues(): void {
  const values = { ...served };
  const authored = { ...servedAuthored };
  for (const path of Object.keys(served)) {
    const asked = edits.get(path);
    if (!asked) continue;
    values[path] = asked.value ?? defaults[path] ?? null;
    authored[path] = asked.value !== null;
  }
  session.set({ values, authored });
}

/** Return the old value if the new one is an equal list, so that nothing is redrawn. */
function unlessSame(old: Value | undefined, value: Value): Value {
  return Array.isArray(old) && JSON.stringify(old) === JSON.stringify(value) ? old : value;
}

function receiveScene(scene: SceneMessage): void {
  served = {};
  servedAuthored = {};
  defaults = {};
  for (const control of scene.controls.flatMap((group) => group.controls)) {
    for (const [path, value, fallback] of attributes(control)) {
      served[path] = value;
      servedAuthored[path] = control.authored;
      defaults[path] = fallback;
    }
  }
  edits.confirm(served);
  const before = session.get();
  const show = { ...before.show };
  // Choices are kept if the scene still has them.
  const kept = (choice: string, choices: string[]): string => (choices.includes(choice) ? choice : (choices[0] ?? ""));
  show.camera = kept(show.camera, scene.cameras);
  show.layer = kept(show.layer, scene.layers);
  if (show.other !== null && !scene.layers.includes(show.other)) show.other = null;
  show.display = kept(show.display, scene.displays);
  if (scene.frames) show.frame = Math.min(Math.max(show.frame, scene.frames[0]), scene.frames[1]);
  const groups = scene.controls;
  show.solo = show.solo.filter((path) => groups.some((group) => group.path === path));
  if (!before.scene && scene.stereo) Object.assign(show, { stereo: scene.stereo, eye: "anaglyph" });
  session.set({ scene, show, everOpen: true });
  mergeValues();
  if (unknown) resendShow();
  else sendChanges(before.show);
  unknown = false;
  edits.flush();
}

/** Send those choices that a new scene has changed. */
function sendChanges(before: Shown): void {
  const { show } = session.get();
  for (const name of ["camera", "layer", "other", "display", "frame", "solo"] as const) {
    if (JSON.stringify(show[name]) !== JSON.stringify(before[name])) Object.assign(unsentShow, { [name]: show[name] });
  }
  showing.request();
}

/** The server knows nothing of what this page showed before the connection was lost. */
function resendShow(): void {
  const { show, scene } = session.get();
  unsentShow = { ...show };
  // A shot without frames or cameras has none that could be sent.
  if (!scene?.frames) delete unsentShow.frame;
  for (const choice of ["camera", "layer", "display"] as const) if (show[choice] === "") delete unsentShow[choice];
  showing.flush();
}

function receive(message: ServerMessage): void {
  switch (message.type) {
    case "scene":
      receiveScene(message);
      break;
    case "values":
      served = { ...served };
      for (const [path, value] of Object.entries(message.values)) served[path] = unlessSame(served[path], value);
      servedAuthored = { ...servedAuthored, ...message.authored };
      edits.confirm(message.values);
      session.set({
        canUndo: message.canUndo,
        canRedo: message.canRedo,
        saved: message.saved,
        restored: message.restored,
        changed: message.saved && session.get().changed?.copy === null ? null : session.get().changed,
        edition: session.get().edition + (Object.keys(message.values).length > 0 ? 1 : 0),
      });
      mergeValues();
      break;
    case "state":
      session.set({ state: message });
      break;
    case "pixel":
      session.set({ pixel: message });
      break;
    case "render":
      // Progress may still be on its way when the picture was cancelled.
      if (!cancelled) session.set({ render: message });
      break;
    case "estimate":
      if (message.number === estimate) session.set({ estimate: message });
      break;
    case "applied":
      session.set({ applied: message });
      break;
    case "kept":
      session.set({ kept: message });
      break;
    case "changed":
      session.set({ changed: message });
      break;
    case "refused":
      edits.forget();
      dismissRefused(message.text);
      session.set({ refused: [...session.get().refused.slice(-2), message.text] });
      break;
  }
}

export function connect(): void {
  connection.open();
}

/** Change what is shown. The newest state wins: what was not sent yet is overwritten. */
export function show(change: Partial<Shown>): void {
  session.set({ show: { ...session.get().show, ...change } });
  Object.assign(unsentShow, change);
  showing.request();
}

/** Edit attributes; null goes back to the default. Edits with the same `step` in a row are undone together. */
export function setValues(values: Values, step: string | null = null): void {
  edits.set(values, step);
}

/** Send a command that concerns the whole scene. */
export function command(type: "undo" | "redo" | "revert" | "discard"): void {
  edits.flush();
  edits.forget();
  post({ type });
}

/** Save the edits; `changed` says what is done if another program has changed their file. */
export function save(changed: "ask" | "merge" | "copy" = "ask"): void {
  edits.flush();
  if (changed === "merge") edits.forget();
  post({ type: "save", changed });
}

export function dismissChanged(): void {
  session.set({ changed: null });
}

/** Apply a preset to a look, or give a light a new look with it. */
export function applyPreset(preset: string, path: string): void {
  edits.flush();
  edits.forget();
  post({ type: "apply", preset, path });
}

/** Keep a look in the library, for other shots. */
export function keepLook(path: string): void {
  edits.flush();
  post({ type: "keep", path });
}

export function inspect(at: [number, number]): void {
  post({ type: "inspect", at });
}

export function startRender(wanted: Omit<Render, "type">): void {
  edits.flush();
  if (post({ type: "render", ...wanted })) {
    cancelled = false;
    session.set({ render: { type: "render", done: 0, of: 100, file: null, written: null, problem: null } });
  }
}

/** Forget the estimate, as it is of other settings now. */
export function forgetEstimate(): void {
  if (session.get().estimate === null) post({ type: "cancel", estimate: true });
  estimate += 1;
  session.set({ estimate: null });
}

/** Ask what a final render takes; the answer is the session's `estimate`. */
export function askEstimate(wanted: Omit<Estimate, "type" | "number">): void {
  edits.flush();
  post({ type: "estimate", number: estimate, ...wanted });
}

export function dismissRefused(text: string): void {
  session.set({ refused: session.get().refused.filter((each) => each !== text) });
}

export function cancelRender(): void {
  cancelled = post({ type: "cancel" });
  if (cancelled) session.set({ render: null });
}

export function forgetRender(): void {
  session.set({ render: null });
}
