// The page without a server: it shows what was computed beforehand, by the values of its sliders.
import { html, LitElement, nothing, type TemplateResult } from "lit";
import { Drawing, type Picture } from "./drawing";
import { nameOf, unitOf } from "./fields";
import type { Merits } from "./frames";
import { merits } from "./merits";
import { ResponsePlot, type Curve } from "./response";

interface Point {
  angle: number[];
  contrast: number[];
  u: number[];
  merits: Merits | null;
  misleading: string;
  pictures: { faces: [string, number][]; ends: string[]; rays: number }[];
}

interface Head {
  solen: string;
  name: string;
  keys: string[];
  values: number[][];
  in_space: boolean;
  step_mm: number;
  points: (Point | null)[];
}

class Player extends LitElement {
  private head: Head = JSON.parse(document.getElementById("head")!.textContent!);
  private numbers = new Int16Array(Uint8Array.from(atob(document.getElementById("numbers")!.textContent!), (c) => c.charCodeAt(0)).buffer);
  private starts = new Map<string, number>(); // where the numbers of a picture begin
  private chosen = this.head.values.map((values) => Math.floor(values.length / 2));
  private turned = 0;
  private drawing!: Drawing;
  private plot!: ResponsePlot;

  constructor() {
    super();
    let place = 0;
    this.head.points.forEach((point, i) =>
      point?.pictures.forEach((one, k) => {
        this.starts.set(`${i} ${k}`, place);
        place += 2 * one.faces.reduce((sum, [, points]) => sum + points, 0) + 4 + 5 * one.rays;
      }),
    );
    this.turned = Math.floor((this.head.points.find(Boolean)?.angle.length ?? 1) / 2);
  }

  protected createRenderRoot(): HTMLElement {
    return this;
  }

  private get place(): number {
    return this.chosen.reduce((sum, choice, k) => sum * this.head.values[k].length + choice, 0);
  }

  private get point(): Point | null {
    return this.head.points[this.place];
  }

  private picture(): Picture | null {
    const one = this.point?.pictures[this.turned];
    if (!one) return null;
    let at = this.starts.get(`${this.place} ${this.turned}`)!;
    const take = (rows: number, columns: number) => {
      const data = Float32Array.from(this.numbers.subarray(at, (at += rows * columns)), (n) => n * this.head.step_mm);
      return { rows, columns, data };
    };
    const outline = take(one.faces.reduce((sum, [, points]) => sum + points, 0), 2);
    const emitter = take(2, 2);
    const stored = take(one.rays, 5);
    const rays = new Float32Array(6 * one.rays);
    for (let i = 0; i < one.rays; i++) {
      rays.set(stored.data.subarray(5 * i, 5 * i + 4), 6 * i);
      rays[6 * i + 4] = 1;
      rays[6 * i + 5] = Math.round(stored.data[5 * i + 4] / this.head.step_mm);
    }
    return { faces: one.faces, ends: one.ends, outline, emitter, rays: { rows: one.rays, columns: 6, data: rays }, handles: {} };
  }

  private curve(): Curve | undefined {
    const point = this.point;
    if (!point) return undefined;
    const ends = (values: number[]) => [values[0], values[values.length - 1]];
    const head = { name: "own", rays: null, in_space: this.head.in_space, finished: true, merits: point.merits, ends: ends(point.contrast), u_ends: ends(point.u) };
    return { head, angle: Float32Array.from(point.angle), contrast: Float32Array.from(point.contrast), u: Float32Array.from(point.u) };
  }

  protected firstUpdated(): void {
    document.title = this.head.name;
    this.drawing = new Drawing(this.querySelector("canvas")!);
    this.plot = new ResponsePlot(this.querySelector(".plot")!, (angle) => this.turnTo(angle), "deg");
    this.plot.theme();
    new ResizeObserver(() => {
      this.drawing.resize();
      const picture = this.picture();
      if (picture) this.drawing.fit(picture);
      this.show();
    }).observe(this.drawing.canvas);
    new ResizeObserver(() => this.plot.resize()).observe(this.querySelector(".plot")!);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.drawing.theme();
      this.plot.theme();
      this.show();
    });
  }

  private show(): void {
    const [picture, curve] = [this.picture(), this.curve()];
    if (picture) this.drawing.draw(picture, "receiver");
    this.plot.show({ own: curve }, curve?.angle[this.turned] ?? 0);
  }

  protected updated(): void {
    this.show();
  }

  private turnTo(angle: number): void {
    const angles = this.point?.angle ?? [];
    this.turned = angles.reduce((best, one, i) => (Math.abs(one - angle) < Math.abs(angles[best] - angle) ? i : best), 0);
    this.requestUpdate();
  }

  private slider(id: string, label: string, place: number, most: number, shown: string, take: (place: number) => void): TemplateResult {
    return html`<div class="angle">
      <label for=${id}>${label}</label>
      <input id=${id} type="range" min="0" max=${most} step="1" .value=${String(place)} aria-valuetext=${shown}
        @input=${(e: Event) => (take(+(e.target as HTMLInputElement).value), this.requestUpdate())}>
      <output>${shown.replace("-", "−")}</output>
    </div>`;
  }

  protected render(): TemplateResult {
    const { head, point } = this;
    const angles = point?.angle ?? [0];
    return html`
      <header><h1><span class="brand">${head.name}</span> simulated by solen ${head.solen}</h1></header>
      <main class="player">
        <section class="sketch" aria-label="Sensor and its rays">
          <div class="stage">
            <canvas role="img" aria-label="Section of the sensor with its rays in the plane"></canvas>
            <ul class="legend" aria-label="Colours of rays"><li><span class="line right"></span>right receiver</li>
              <li><span class="line left"></span>left receiver</li><li><span class="line lost"></span>lost</li></ul>
          </div>
          ${this.slider("angle", "angle", this.turned, angles.length - 1, `${+(angles[this.turned] ?? 0).toFixed(3)}°`, (place) => (this.turned = place))}
          ${head.keys.map((key, k) => {
            const [table, name] = [key.split(".")[0], key.split(".").slice(1).join(".")];
            const value = head.values[k][this.chosen[k]];
            return this.slider(key, `${table} ${nameOf(name)}`, this.chosen[k], head.values[k].length - 1, `${+value.toPrecision(6)} ${unitOf(name)}`, (place) => (this.chosen[k] = place));
          })}
        </section>
        <section class="answer" aria-label="Response">
          <div class="plot" role="img" aria-label="Contrast against the angle, with its uncertainty"></div>
          <p class="quality">${point ? `Traced ${head.in_space ? "in space" : "in the plane"}; rays are drawn in the plane.` : "This sensor cannot be built."}</p>
          ${point?.misleading ? html`<p class="warning" role="alert">${point.misleading}</p>` : nothing}
          ${merits(this.curve(), null, [angles[0], angles[angles.length - 1]], "deg")}
        </section>
      </main>`;
  }
}

customElements.define("solen-player", Player);
