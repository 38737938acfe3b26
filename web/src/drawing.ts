// The sensor as drawn: outline, emitter and rays on a canvas that is zoomed and panned. What is drawn comes from the server.
import type { Columns } from "./frames";

export interface Picture {
  faces: [string, number][];
  ends: string[];
  outline: Columns;
  emitter: Columns;
  rays: Columns;
  handles: Record<string, [number, number]>;
}

export type Colouring = "receiver" | "fate" | "power";

const STEPS = 6; // of power, each with its own opacity

export class Drawing {
  scale = 1; // pixels per mm
  x = 0; // mm at the middle of the canvas
  z = 0;
  private fitted = false;
  size: [number, number] = [0, 0]; // in pixels of the page; asking the canvas for it makes the browser lay the page out
  private readonly context: CanvasRenderingContext2D;
  private colours: Record<string, string> = {};
  private font = "";
  ruler: [number, number, number, number] | null = null;

  constructor(readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d", { desynchronized: true })!;
    this.theme();
    this.resize();
  }

  theme(): void {
    const style = getComputedStyle(this.canvas);
    for (const name of ["ink", "soft", "body", "right", "left", "lost", "hit", "taken", "cut", "accent"])
      this.colours[name] = style.getPropertyValue(`--${name}`).trim();
    this.font = `${0.86 * parseFloat(style.fontSize)}px system-ui, sans-serif`;
  }

  resize(): void {
    const ratio = devicePixelRatio;
    const [width, height] = (this.size = [this.canvas.clientWidth, this.canvas.clientHeight]);
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
  }

  fit(picture: Picture): void {
    const { data } = picture.outline;
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (let i = 0; i < data.length; i += 2) {
      left = Math.min(left, data[i]);
      right = Math.max(right, data[i]);
      low = Math.min(low, data[i + 1]);
      high = Math.max(high, data[i + 1]);
    }
    for (const [x, z] of Object.values(picture.handles)) {
      left = Math.min(left, x);
      right = Math.max(right, x);
      low = Math.min(low, z);
      high = Math.max(high, z);
    }
    const [width, height] = this.size;
    this.scale = 0.9 * Math.min(width / Math.max(right - left, 1e-3), height / Math.max(high - low, 1e-3));
    this.x = 0.5 * (left + right);
    this.z = 0.5 * (low + high);
    this.fitted = true;
  }

  // The same part of the plane as another drawing shows.
  like({ scale, x, z }: Drawing): void {
    Object.assign(this, { scale, x, z, fitted: true });
  }

  toPixel(x: number, z: number): [number, number] {
    const [width, height] = this.size;
    return [width / 2 + (x - this.x) * this.scale, height / 2 - (z - this.z) * this.scale];
  }

  toPoint(px: number, py: number): [number, number] {
    const [width, height] = this.size;
    return [this.x + (px - width / 2) / this.scale, this.z - (py - height / 2) / this.scale];
  }

  zoom(factor: number, px?: number, py?: number): void {
    const [width, height] = this.size;
    const [x, z] = this.toPoint(px ?? width / 2, py ?? height / 2);
    const scale = Math.min(Math.max(this.scale * factor, 1), 5e4);
    this.x = x + (this.x - x) * (this.scale / scale);
    this.z = z + (this.z - z) * (this.scale / scale);
    this.scale = scale;
  }

  draw(picture: Picture, colouring: Colouring): void {
    if (!this.fitted) this.fit(picture);
    const { context } = this;
    const ratio = this.canvas.width / Math.max(this.size[0], 1);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, ...this.size);
    this.body(picture);
    this.grid();
    this.rays(picture, colouring);
    this.faces(picture);
    this.emitter(picture);
    if (this.ruler) this.measure(this.ruler);
  }

  // Places along the outline in pixels, face by face.
  *facesOf(picture: Picture): Generator<[string, [number, number][]]> {
    const { data } = picture.outline;
    let place = 0;
    for (const [name, points] of picture.faces) {
      const line: [number, number][] = [];
      for (let i = 0; i < points; i++, place += 2) line.push(this.toPixel(data[place], data[place + 1]));
      yield [name, line];
    }
  }

  private body(picture: Picture): void {
    const { context } = this;
    context.fillStyle = this.colours.body;
    context.beginPath();
    let [px, py] = [NaN, NaN];
    for (const [, line] of this.facesOf(picture))
      for (const [i, [x, y]] of line.entries()) {
        if (i === 0 && !(Math.hypot(x - px, y - py) < 0.01 * this.scale + 0.5)) context.moveTo(x, y);
        else context.lineTo(x, y);
        [px, py] = [x, y];
      }
    context.fill("evenodd");
  }

  private grid(): void {
    // A scale bar in place of a grid: a grid redrawn with each frame costs more than it says.
    const { context } = this;
    const target = 120 / this.scale;
    const power = 10 ** Math.floor(Math.log10(target));
    const mm = [5, 2, 1].map((n) => n * power).find((n) => n <= target) ?? power;
    const [, height] = this.size;
    const y = height - 18;
    this.stroke([[16, y], [16 + mm * this.scale, y]], this.colours.ink, 2);
    context.fillStyle = this.colours.ink;
    context.font = this.font;
    context.fillText(mm < 0.1 ? `${+(1000 * mm).toPrecision(2)} µm` : `${+mm.toPrecision(2)} mm`, 16, y - 6);
  }

  // Paths of rays by their colour and opacity.
  bundles(picture: Picture, colouring: Colouring): Map<string, { colour: string; alpha: number; legs: number[] }> {
    const { data, rows } = picture.rays;
    const bundles = new Map<string, { colour: string; alpha: number; legs: number[] }>();
    const receivers = picture.ends.length - 3;
    for (let row = 0; row < rows; row++) {
      const [power, end] = [data[6 * row + 4], data[6 * row + 5]];
      let [colour, alpha] = [this.colourOf(picture.ends[end] ?? "", end < receivers, colouring), 0.5];
      if (colouring === "power") alpha = Math.max(1, Math.ceil(STEPS * Math.sqrt(Math.min(power, 1)))) / STEPS;
      else if (end >= receivers && colouring === "receiver") alpha = 0.35;
      const key = `${colour} ${alpha}`;
      const bundle = bundles.get(key) ?? { colour, alpha, legs: [] };
      bundle.legs.push(row);
      bundles.set(key, bundle);
    }
    return bundles;
  }

  private colourOf(end: string, received: boolean, colouring: Colouring): string {
    if (colouring === "power") return this.colours.accent;
    if (colouring === "fate") {
      if (received) return this.colours.hit;
      return end === "absorbed" ? this.colours.taken : end === "truncated" ? this.colours.cut : this.colours.lost;
    }
    if (!received) return this.colours.lost;
    return end.startsWith("left") ? this.colours.left : end.startsWith("right") ? this.colours.right : this.colours.hit;
  }

  private rays(picture: Picture, colouring: Colouring): void {
    const { context } = this;
    const { data } = picture.rays;
    context.lineWidth = 0.9;
    const [[left, top], scale] = [this.toPixel(0, 0), this.scale];
    for (const { colour, alpha, legs } of this.bundles(picture, colouring).values()) {
      context.globalAlpha = alpha;
      context.strokeStyle = colour;
      context.beginPath();
      for (const row of legs) {
        context.moveTo(left + scale * data[6 * row], top - scale * data[6 * row + 1]);
        context.lineTo(left + scale * data[6 * row + 2], top - scale * data[6 * row + 3]);
      }
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  private stroke(points: [number, number][], colour: string, width: number): void {
    const { context } = this;
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
  }

  styleOf(face: string): [string, number] {
    if (face.startsWith("lens")) return [this.colours.accent, 2.5];
    if (face.startsWith("receiver-right")) return [this.colours.right, 5];
    if (face.startsWith("receiver-left")) return [this.colours.left, 5];
    return face.startsWith("receiver") ? [this.colours.hit, 5] : [this.colours.ink, 1.2];
  }

  private faces(picture: Picture): void {
    for (const [name, line] of this.facesOf(picture)) this.stroke(line, ...this.styleOf(name));
  }

  private emitter(picture: Picture): void {
    const { data } = picture.emitter;
    const [from, to] = [this.toPixel(data[0], data[1]), this.toPixel(data[2], data[3])];
    this.stroke([from, to], this.colours.ink, 4);
  }

  private measure([x0, z0, x1, z1]: [number, number, number, number]): void {
    const [from, to] = [this.toPixel(x0, z0), this.toPixel(x1, z1)];
    this.stroke([from, to], this.colours.ink, 1.5);
    this.context.fillStyle = this.colours.ink;
    this.context.fillText(`${Math.hypot(x1 - x0, z1 - z0).toFixed(3)} mm`, to[0] + 8, to[1] - 8);
  }

  // The drawing as SVG, in pixels of the canvas.
  svg(picture: Picture, colouring: Colouring): string {
    const [width, height] = this.size;
    const path = (points: [number, number][]) => points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");
    const parts: string[] = [];
    const { data } = picture.rays;
    for (const { colour, alpha, legs } of this.bundles(picture, colouring).values()) {
      const d = legs
        .map((row) => path([this.toPixel(data[6 * row], data[6 * row + 1]), this.toPixel(data[6 * row + 2], data[6 * row + 3])]))
        .join("");
      parts.push(`<path d="${d}" stroke="${colour}" stroke-opacity="${alpha}" stroke-width="0.9"/>`);
    }
    for (const [name, line] of this.facesOf(picture)) {
      const [colour, wide] = this.styleOf(name);
      parts.push(`<path d="${path(line)}" stroke="${colour}" stroke-width="${wide}"/>`);
    }
    const head = `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}">`;
    return `${head}<g fill="none">${parts.join("")}</g></svg>`;
  }
}
