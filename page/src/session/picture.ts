/** The newest picture, decoded; and snapshots of earlier ones to compare it with. */

import type { PictureHeader } from "../protocol";
import { Store } from "./store";

/** A picture takes megabytes, so the number of snapshots is limited. */
const MOST_SNAPSHOTS = 8;

export interface ShownPicture {
  header: PictureHeader;
  bitmap: ImageBitmap;
}

export interface Snapshot extends ShownPicture {
  id: number;
  label: string;
}

/** Split a binary message into its header and the encoded picture. */
function readPicture(message: ArrayBuffer): { header: PictureHeader; picture: Blob } {
  const length = new DataView(message).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(message, 4, length))) as PictureHeader;
  return { header, picture: new Blob([new Uint8Array(message, 4 + length)], { type: header.mime }) };
}

interface PictureState {
  shown: ShownPicture | null;
  /** The other layer of the picture, if one is compared. */
  other: ShownPicture | null;
  snapshots: Snapshot[];
}

export class Picture extends Store<PictureState> {
  private waiting: ArrayBuffer | null = null;
  /** The other layer, which comes before the picture: it is shown with it. */
  private beside: ArrayBuffer | null = null;
  private decoding = false;
  private count = 0;

  constructor() {
    super({ shown: null, other: null, snapshots: [] });
  }

  /** Decode a binary message. Pictures that come while one is being decoded replace each other: the newest wins. */
  receive(message: ArrayBuffer): void {
    if (readPicture(message).header.compared) {
      this.beside = message;
      return;
    }
    this.waiting = message;
    if (!this.decoding) void this.decode();
  }

  private async decode(): Promise<void> {
    this.decoding = true;
    while (this.waiting) {
      const { header, picture } = readPicture(this.waiting);
      const beside = this.beside && readPicture(this.beside);
      this.waiting = null;
      this.beside = null;
      try {
        const bitmap = await createImageBitmap(picture);
        const other = beside && { header: beside.header, bitmap: await createImageBitmap(beside.picture) };
        const { shown, other: last } = this.get();
        this.set({ shown: { header, bitmap }, other });
        if (shown && !this.get().snapshots.some((snapshot) => snapshot.bitmap === shown.bitmap)) shown.bitmap.close();
        last?.bitmap.close();
      } catch (error) {
        // The next picture replaces it anyway.
        console.warn("a picture could not be decoded", error);
      }
    }
    this.decoding = false;
  }

  /** Keep the present picture; returns it, or null when there is none yet. */
  keep(): Snapshot | null {
    const { shown, snapshots } = this.get();
    if (!shown) return null;
    this.count += 1;
    const { layer, passes } = shown.header;
    const label = `${layer}, ${passes} ${passes === 1 ? "pass" : "passes"} (${this.count})`;
    const snapshot = { ...shown, id: this.count, label };
    for (const old of snapshots.slice(0, -MOST_SNAPSHOTS + 1)) this.close(old);
    this.set({ snapshots: [...snapshots.slice(-MOST_SNAPSHOTS + 1), snapshot] });
    return snapshot;
  }

  drop(id: number): void {
    const { snapshots } = this.get();
    const dropped = snapshots.find((snapshot) => snapshot.id === id);
    this.set({ snapshots: snapshots.filter((snapshot) => snapshot !== dropped) });
    if (dropped) this.close(dropped);
  }

  /** Free a snapshot's memory, unless the same bitmap is still used elsewhere. */
  private close(snapshot: Snapshot): void {
    const { shown, snapshots } = this.get();
    const others = snapshots.filter((each) => each.id !== snapshot.id);
    if (shown?.bitmap !== snapshot.bitmap && !others.some((each) => each.bitmap === snapshot.bitmap)) {
      snapshot.bitmap.close();
    }
  }
}
