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

  picture(): HTMLCanvasElement | null {
    return this.plot?.ctx.canvas ?? null;
  }
}
