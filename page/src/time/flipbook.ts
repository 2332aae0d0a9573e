/** A flipbook: small pictures of frames, which are kept as they come, and played at the speed of the shot. */

import { picture, type SessionState, session, show } from "../session/session";
import { type ShownPicture } from "../session/picture";
import { Store } from "../session/store";

/** Pixels of a kept picture's width, and how many are kept: a hundred take about 100 MB. */
const WIDTH = 640;
const MOST = 240;
/** Pictures with a smaller scale are too coarse to be kept. */
const COARSEST = 0.3;

export interface Page {
  bitmap: ImageBitmap;
  /** The other layer, if one is compared. */
  other: ImageBitmap | null;
}

interface Flipbook {
  /** Whether frames are collected, and which there are, ascending. */
  on: boolean;
  frames: number[];
  /** The frame that is played; null: the live picture is shown. */
  at: number | null;
}

const pages = new Map<number, Page>();
export const flipbook = new Store<Flipbook>({ on: false, frames: [], at: null });

export function pageOf(frame: number | null): Page | undefined {
  return frame === null ? undefined : pages.get(frame);
}

/** All that pictures depend on, except the frame. */
function contentOf({ show: shown, edition }: SessionState): string {
  return JSON.stringify({ ...shown, frame: 0, paused: false, edition });
}

let content = "";

function clear(): void {
  for (const each of pages.values()) {
    each.bitmap.close();
    each.other?.close();
  }
  pages.clear();
  flipbook.set({ frames: [], at: null });
}

const small = ({ bitmap }: ShownPicture): Promise<ImageBitmap> =>
  createImageBitmap(bitmap, { resizeWidth: Math.min(WIDTH, bitmap.width), resizeQuality: "medium" });

/** Keep a picture if it is of the present content, and go on to the next frame that is not there. */
async function keep(): Promise<void> {
  const { show: shown, scene, state } = session.get();
  const { shown: present, other } = picture.get();
  const header = present?.header;
  if (!flipbook.get().on || !scene?.frames || !present || !header || header.scale < COARSEST) return;
  const frame = header.frame ?? null;
  if (frame === null || header.version !== state?.version || frame !== shown.frame) return;
  if ((shown.other !== null) !== (other !== null)) return;
  const now = contentOf(session.get());
  const page = { bitmap: await small(present), other: other && (await small(other)) };
  if (contentOf(session.get()) !== now || !flipbook.get().on) return;
  pages.set(frame, page);
  flipbook.set({ frames: [...pages.keys()].sort((a, b) => a - b) });
  const [first, last] = scene.frames;
  const count = Math.min(last - first + 1, MOST);
  for (let i = 1; i < last - first + 1 && pages.size < count; i++) {
    const next = first + ((frame - first + i) % (last - first + 1));
    if (!pages.has(next)) return show({ frame: next });
  }
}

/** Begin or end to collect frames; what was collected is forgotten at the end. */
export function toggleFlipbook(): void {
  const on = !flipbook.get().on;
  flipbook.set({ on });
  if (on) void keep();
  else clear();
}

session.subscribe(() => {
  if (!flipbook.get().on && pages.size === 0) return;
  const now = contentOf(session.get());
  if (now === content) return;
  content = now;
  if (pages.size > 0) clear();
});
picture.subscribe(() => void keep());
