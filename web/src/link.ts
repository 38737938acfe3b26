// The connection to the server. Only the newest request counts: the server drops those of a drag that are outdated.
import { decoded, type Frame } from "./frames";
import type { Sought } from "./search";

export interface View {
  angle_deg: number;
  rays: number;
  split: boolean;
  light: "design" | "plane" | "space";
  lens: "own" | "designed" | "flat";
  tolerances: boolean;
  lit?: string;
}

export interface Request {
  view?: View;
  values?: Record<string, unknown>;
  handle?: string;
  to?: [number, number];
  gesture?: string;
  do?: "undo" | "redo" | "save" | "reload" | "suggest" | "restore" | "leave" | "pin";
  search?: Sought;
  take?: number;
}

export class Link {
  private socket!: WebSocket;
  private number = 0;
  private sent = new Map<number, number>();

  constructor(
    private readonly take: (frame: Frame) => void,
    private readonly lost: (connected: boolean) => void,
  ) {
    this.open();
  }

  private open(): void {
    const address = new URL("ws", location.href);
    address.protocol = "ws:";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => this.lost(true);
    this.socket.onmessage = (event) => {
      const frame = decoded(event.data as ArrayBuffer);
      this.take(frame);
      if (frame.head.kind === "drawn") this.measure(frame.head.id as number);
    };
    this.socket.onclose = () => {
      this.lost(false);
      setTimeout(() => this.open(), 2000);
    };
  }

  get longest(): number {
    return this.sent.size ? performance.now() - Math.min(...this.sent.values()) : 0;
  }

  // Number of the request, which its answer bears.
  ask(request: Request): number {
    if (this.socket.readyState !== WebSocket.OPEN) return this.number;
    this.number += 1;
    this.sent.set(this.number, performance.now());
    this.socket.send(JSON.stringify({ id: this.number, ...request }));
    return this.number;
  }

  // A request that was refused is answered as well.
  answered(id: number): void {
    for (const number of this.sent.keys()) if (number <= id) this.sent.delete(number);
  }

  private measure(id: number): void {
    const start = this.sent.get(id);
    if (start !== undefined) performance.measure("request to drawn", { start });
    this.answered(id);
  }
}
