// The course of what runs: values over time, sent by the server.
import uPlot from "uplot";

export interface Course {
  names: string[];
  axis: string;
  columns: (number | null)[][];
}

const ENDS = "from (95 %)"; // as solen/studio/live.py names it
const COLOURS = ["right", "left", "hit", "taken", "cut", "lost"];

export class LivePlot {
  private plot: uPlot | null = null;
  private shown = "";

  constructor(private readonly place: HTMLElement) {
    new ResizeObserver(() => this.plot?.setSize({ width: place.clientWidth, height: place.clientHeight })).observe(place);
  }

  show({ names, axis, columns }: Course): void {
    const what = [axis, ...names].join();
    if (what !== this.shown) this.plot?.destroy();
    if (what !== this.shown || !this.plot) this.plot = this.make(names, axis);
    this.shown = what;
    this.plot.setData(columns as uPlot.AlignedData);
  }

  private make(names: string[], axis: string): uPlot {
    const style = getComputedStyle(this.place);
    const colour = (name: string) => style.getPropertyValue(`--${name}`).trim();
    const font = `${0.86 * parseFloat(style.fontSize)}px system-ui, sans-serif`;
    const look = { stroke: colour("ink"), grid: { stroke: colour("soft"), width: 1 }, ticks: { stroke: colour("soft") }, font, labelFont: font };
    const banded = names.length === 3 && names[1] === ENDS; // a value within its interval
    return new uPlot(
      {
        width: this.place.clientWidth,
        height: this.place.clientHeight,
        legend: { show: false },
        cursor: { show: false },
        scales: { x: { time: false } },
        axes: [{ ...look, label: "time / s", labelSize: 22, size: 40 }, { ...look, label: axis, labelSize: 20, size: 60 }],
        series: [{}, ...names.map((_, i) => ({ stroke: banded && i ? "transparent" : colour(banded ? "accent" : COLOURS[i % COLOURS.length]), width: 1.5, dash: i < COLOURS.length ? [] : [6, 4], points: { show: false } }))],
        bands: banded ? [{ series: [3, 2] as [number, number], fill: colour("band") }] : [],
      },
      [[], ...names.map(() => [])] as unknown as uPlot.AlignedData,
      this.place,
    );
  }
}

// Colour and name of each value, for a legend beside the plot.
export const legendOf = ({ names }: Course): [string, string][] =>
  names.length === 3 && names[1] === ENDS ? [["accent", `${names[0].replace("_", " / ")}, within 95 %`]] : names.map((name, i) => [COLOURS[i % COLOURS.length], name]);
