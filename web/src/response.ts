// The response curve: contrast against the angle with its uncertainty, and what it is compared with.
import uPlot from "uplot";
import type { Columns, CurveHead, Frame } from "./frames";

export interface Curve {
  head: CurveHead;
  angle: Float32Array;
  contrast: Float32Array;
  u: Float32Array;
}

export function curveOf(frame: Frame): Curve | null {
  const head = frame.head.curve as CurveHead | undefined;
  if (!head) return null;
  const column = (name: string): Columns => frame.arrays[`${head.name}_${name}`];
  return { head, angle: column("angle").data, contrast: column("contrast").data, u: column("u").data };
}

// By how much all tolerances together move the contrast, to either side.
export interface Band {
  angle: Float32Array;
  size: Float32Array;
}

export const SERIES = ["own", "flat", "other", "pinned"] as const;
export type Name = (typeof SERIES)[number];

export class ResponsePlot {
  private plot: uPlot | null = null;
  private colours: Record<string, string> = {};
  private angle = 0;

  constructor(
    private readonly place: HTMLElement,
    private readonly turn: (angle: number) => void,
    private unit: string,
  ) {}

  theme(): void {
    const style = getComputedStyle(this.place);
    for (const name of ["ink", "soft", "accent", "lost", "hit", "taken", "band", "tolerated"])
      this.colours[name] = style.getPropertyValue(`--${name}`).trim();
    this.plot?.destroy();
    this.plot = null;
  }

  private make(): uPlot {
    const { ink, soft, accent, lost, hit, taken, band, tolerated } = this.colours;
    const font = `${0.86 * parseFloat(getComputedStyle(this.place).fontSize)}px system-ui, sans-serif`;
    const axis = { stroke: ink, grid: { stroke: soft, width: 1 }, ticks: { stroke: soft }, font };
    const plot: uPlot = new uPlot(
      {
        width: this.place.clientWidth,
        height: this.place.clientHeight,
        legend: { show: false },
        cursor: { drag: { x: false, y: false }, points: { show: false }, y: false },
        scales: { x: { time: false }, y: { range: (_, low, high) => [Math.min(-1, low), Math.max(1, high)] } },
        axes: [
          { ...axis, label: this.unit === "deg" ? "angle / °" : `driven / ${this.unit}`, labelSize: 22, size: 40, labelFont: axis.font },
          { ...axis, label: "contrast (R − L)/(R + L)", labelSize: 20, size: 54, space: 36, labelFont: axis.font },
        ],
        series: [
          {},
          { stroke: "transparent", points: { show: false }, spanGaps: true },
          { stroke: "transparent", points: { show: false }, spanGaps: true },
          { stroke: lost, width: 1.5, dash: [6, 4], points: { show: false }, spanGaps: true },
          { stroke: hit, width: 1.5, dash: [2, 3], points: { show: false }, spanGaps: true },
          { stroke: taken, width: 1.5, dash: [10, 3, 2, 3], points: { show: false }, spanGaps: true },
          { stroke: accent, width: 2.5, points: { show: false }, spanGaps: true },
          { stroke: "transparent", points: { show: false }, spanGaps: true },
          { stroke: "transparent", points: { show: false }, spanGaps: true },
        ],
        bands: [{ series: [2, 1], fill: band }, { series: [8, 7], fill: tolerated }],
        hooks: { draw: [(u) => this.marker(u)] },
      },
      [[], [], [], [], [], [], [], [], []],
      this.place,
    );
    const at = (event: PointerEvent) => {
      const box = plot.over.getBoundingClientRect();
      this.turn(plot.posToVal(event.clientX - box.left, "x"));
    };
    plot.over.addEventListener("pointerdown", (event) => {
      plot.over.setPointerCapture(event.pointerId);
      at(event);
      plot.over.onpointermove = at;
      plot.over.onpointerup = plot.over.onpointercancel = () => (plot.over.onpointermove = null);
    });
    return plot;
  }

  private marker(u: uPlot): void {
    const x = u.valToPos(this.angle, "x", true);
    const { ctx, bbox } = u;
    if (!Number.isFinite(x)) return;
    ctx.save();
    ctx.strokeStyle = this.colours.ink;
    ctx.globalAlpha = 0.6;
    ctx.lineWidth = devicePixelRatio;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    ctx.restore();
  }

  resize(): void {
    this.plot?.setSize({ width: this.place.clientWidth, height: this.place.clientHeight });
  }

  show(curves: Partial<Record<Name, Curve>>, angle: number, band?: Band): void {
    this.angle = angle;
    this.plot ??= this.make();
    const table = (curve: Curve | undefined, ...columns: ((c: Curve, i: number) => number)[]): uPlot.AlignedData => {
      const x = curve ? Array.from(curve.angle, (value) => +value.toFixed(4)) : [];
      return [x, ...columns.map((column) => x.map((_, i) => column(curve!, i)))] as uPlot.AlignedData;
    };
    const value = (c: Curve, i: number) => c.contrast[i];
    const joined = uPlot.join([
      table(curves.own, (c, i) => c.contrast[i] - c.u[i], (c, i) => c.contrast[i] + c.u[i]),
      table(curves.flat, value),
      table(curves.other, value),
      table(curves.pinned, value),
      table(curves.own, value),
      this.tolerated(curves.own, band),
    ]);
    this.plot.setData(joined);
  }

  private tolerated(own: Curve | undefined, band: Band | undefined): uPlot.AlignedData {
    const places = [...(own && band ? band.angle : [])].map((angle) => [+angle.toFixed(4), own!.angle.findIndex((one) => Math.abs(one - angle) < 1e-4)]);
    const [x, low, high]: number[][] = [[], [], []];
    places.forEach(([angle, k], i) => {
      if (k < 0) return;
      x.push(angle);
      low.push(own!.contrast[k] - band!.size[i]);
      high.push(own!.contrast[k] + band!.size[i]);
    });
    return [x, low, high];
  }

  move(angle: number): void {
    this.angle = angle;
    this.plot?.redraw(false);
  }

  // The plot as SVG: curves as paths in its own scales, with axes, labels and the angle that is shown.
  svg(): string {
    const plot = this.plot!;
    const [width, height] = [plot.width, plot.height];
    const { ink, soft, accent, lost, hit, taken, band, tolerated } = this.colours;
    const [left, top] = [plot.over.offsetLeft, plot.over.offsetTop];
    const [wide, high] = [plot.over.clientWidth, plot.over.clientHeight];
    const place = (x: number, y: number) => `${(left + plot.valToPos(x, "x")).toFixed(2)} ${(top + plot.valToPos(y, "y")).toFixed(2)}`;
    const points = (series: number) => {
      const [x, y] = [plot.data[0], plot.data[series]];
      return Array.from(x, (value, i) => [value, y[i]] as const).filter(([, value]) => value != null && Number.isFinite(value)).map(([a, b]) => place(a, b!));
    };
    const path = (series: number) => points(series).map((at, i) => `${i ? "L" : "M"}${at}`).join("");
    const area = (low: number, high: number, fill: string) => {
      const around = [...points(high), ...points(low).reverse()];
      return around.length ? `<path d="M${around.join("L")}Z" fill="${fill}"/>` : "";
    };
    const line = (series: number, colour: string, wide: number, dash: string) => {
      const d = path(series);
      return d ? `<path d="${d}" fill="none" stroke="${colour}" stroke-width="${wide}"${dash ? ` stroke-dasharray="${dash}"` : ""}/>` : "";
    };
    const text = (x: number, y: number, words: string, more = 'text-anchor="middle"') => `<text x="${x.toFixed(1)}" y="${y.toFixed(1)}" ${more}>${words}</text>`;
    const number = (value: number) => `${+value.toFixed(6)}`.replace("-", "−");
    const inside = (values: readonly number[], scale: "x" | "y") => values.filter((value) => value >= plot.scales[scale].min! && value <= plot.scales[scale].max!);
    const ticks = (axis: 0 | 1) => inside(((plot.axes[axis] as { _splits?: number[] })._splits ?? []), axis ? "y" : "x");
    const grid = [
      ...ticks(0).map((x) => { const at = left + plot.valToPos(x, "x"); return `<path d="M${at.toFixed(2)} ${top}v${high}" stroke="${soft}"/>${text(at, top + high + 18, number(x))}`; }),
      ...ticks(1).map((y) => { const at = top + plot.valToPos(y, "y"); return `<path d="M${left} ${at.toFixed(2)}h${wide}" stroke="${soft}"/>${text(left - 8, at + 4, number(y), 'text-anchor="end"')}`; }),
    ];
    const now = left + plot.valToPos(this.angle, "x");
    return [
      `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" font-family="system-ui, sans-serif" font-size="12" fill="${ink}">`,
      ...grid, area(7, 8, tolerated), area(1, 2, band),
      line(3, lost, 1.5, "6 4"), line(4, hit, 1.5, "2 3"), line(5, taken, 1.5, "10 3 2 3"), line(6, accent, 2.5, ""),
      `<path d="M${now.toFixed(2)} ${top}v${high}" stroke="${ink}" stroke-opacity="0.6"/>`,
      text(left + wide / 2, height - 4, this.unit === "deg" ? "angle / °" : `driven / ${this.unit}`),
      text(0, 0, "contrast (R − L)/(R + L)", `text-anchor="middle" transform="translate(12 ${top + high / 2}) rotate(-90)"`),
      "</svg>",
    ].join("");
  }

  picture(): HTMLCanvasElement | null {
    return this.plot?.ctx.canvas ?? null;
  }
}
