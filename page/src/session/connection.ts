/** The WebSocket to the server, which is opened again whenever it is lost. */

import type { PageMessage, ServerMessage } from "../protocol";

const FIRST_WAIT = 500;
const LONGEST_WAIT = 8000;
const TOKEN = "photonbeams-token";

/** The token of this page's address; it is stored for addresses without one. */
export function token(): string {
  const given = new URLSearchParams(location.search).get("token");
  if (given !== null) sessionStorage.setItem(TOKEN, given);
  return given ?? sessionStorage.getItem(TOKEN) ?? "";
}

export interface ConnectionEvents {
  message(message: ServerMessage): void;
  picture(message: ArrayBuffer): void;
  /** `retryAt` is the time of the next try in milliseconds since 1970, null while there is none to wait for. */
  status(open: boolean, retryAt: number | null): void;
}

export class Connection {
  private socket: WebSocket | null = null;
  private wait = FIRST_WAIT;
  private timer: number | undefined;

  constructor(private readonly events: ConnectionEvents) {}

  open(): void {
    window.clearTimeout(this.timer);
    const before = this.socket;
    this.socket = null;
    before?.close();
    this.events.status(false, null);
    // Beside the page, which a proxy may have under another port and path.
    const address = new URL(`session?token=${encodeURIComponent(token())}`, location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      if (this.socket !== socket) return;
      this.wait = FIRST_WAIT;
      this.events.status(true, null);
    };
    socket.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => {
      if (this.socket !== socket) return;
      if (typeof data === "string") this.events.message(JSON.parse(data) as ServerMessage);
      else this.events.picture(data);
    };
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.socket = null;
      this.events.status(false, Date.now() + this.wait);
      this.timer = window.setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
    };
    this.socket = socket;
  }

  get isOpen(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Send a message; false when there is no connection. */
  send(message: PageMessage): boolean {
    if (!this.isOpen) return false;
    this.socket?.send(JSON.stringify(message));
    return true;
  }
}
