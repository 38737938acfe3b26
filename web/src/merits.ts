// The numbers of a response, with their uncertainties.
import { html, type TemplateResult } from "lit";
import type { Curve } from "./response";

// What each receiver of a network gets of each emitter, and its readings.
export interface Powers {
  emitters: string[];
  receivers: string[];
  readings: string[];
  power: number[][][];
  u_power: number[][][];
  reading: (number | null)[][];
  u_reading: (number | null)[][];
  in_space: boolean;
}

export function powers({ emitters, receivers, readings, power, u_power, reading, u_reading, in_space }: Powers): TemplateResult {
  const head = (first: string, names: string[]) => html`<thead><tr><th scope="col">${first}</th>${names.map((name) => html`<th scope="col">${name}</th>`)}</tr></thead>`;
  return html`<p class="quality">Share of each emitter's power at each receiver, as the motions stand, ${in_space ? "in space" : "in the plane"}.</p>
    <table class="merits many powers">${head("Receiver", emitters)}<tbody>${receivers.map((name, k) => html`<tr><th scope="row">${name}</th>
      ${emitters.map((_, i) => html`<td>${measured(power[0][i][k], u_power[0][i][k])}</td>`)}</tr>`)}</tbody></table>
    ${readings.length ? html`<table class="merits readings">${head("Reading", ["value"])}<tbody>${readings.map((name, i) => html`<tr><th scope="row">${name}</th>
      <td>${measured(reading[0][i], u_reading[0][i])}</td></tr>`)}</tbody></table>` : ""}`;
}

// A value with as many digits as its uncertainty warrants.
export function measured(value: number | null | undefined, u: number | null | undefined): string {
  if (value === null || value === undefined) return "–";
  if (u === null || u === undefined || !(u > 0)) return `${+value.toPrecision(3)}`.replace("-", "−");
  const power = Math.floor(Math.log10(u));
  const digits = Math.min(Math.max(0, (u / 10 ** power < 3 ? 1 : 0) - power), 6);
  const shown = +value.toFixed(digits) === 0 ? 0 : value; // not −0
  return `${shown.toFixed(digits)} ± ${u.toFixed(digits)}`.replace("-", "−");
}

export function sign(angle: number, unit = "deg"): string {
  return `${angle < 0 ? "−" : angle > 0 ? "+" : ""}${Math.abs(angle)}${unit === "deg" ? "°" : ` ${unit}`}`;
}

const ROWS: [string, string, string, string][] = [
  ["slope_per_deg", "slope at the null", "1/°", "Slope of the contrast at the null."],
  ["null_deg", "null", "°", "Angle at which both receivers receive equal light."],
  ["span", "span", "", "Contrast at the last angle minus contrast at the first."],
  ["linearity_percent", "linearity", "%", "Largest deviation from the best straight line, in percent of the span."],
  ["range_deg", "range", "°", "Range about the null over which the contrast is monotonic."],
  ["light", "light", "", "Smallest fraction of the emitted power that reaches both receivers together."],
  ["resolution_deg", "resolution", "°", "Largest standard deviation of an angle from one reading."],
];

export function merits(own: Curve | undefined, flat: Curve | undefined | null, angles: [number, number], unit: string, pinned?: Curve): TemplateResult {
  const curves = [own, ...(flat === null ? [] : [flat]), ...(pinned ? [pinned] : [])];
  const at = (curve: Curve | undefined | null, end: number) => (curve ? measured(curve.head.ends[end], curve.head.u_ends[end]) : "–");
  const row = (id: string, name: string, help: string, values: string[], unit: string) => html`<tr id="merit-${id}">
    <th scope="row" title=${help}>${name}${unit ? html` <span class="unit">${unit}</span>` : ""}</th>${values.map((value) => html`<td>${value}</td>`)}
  </tr>`;
  const of = (curve: Curve | undefined | null, key: string) => measured(curve?.head.merits?.[key], curve?.head.merits?.[`u_${key}`]);
  return html`<table class="merits ${pinned ? "many" : ""}">
    <thead><tr><th scope="col">Merit</th><th scope="col">design</th>${flat !== null ? html`<th scope="col">no lens</th>` : ""}${pinned ? html`<th scope="col">pinned</th>` : ""}</tr></thead>
    <tbody>
      ${row("from", `contrast at ${sign(angles[0], unit)}`, "At the first angle of the motion.", curves.map((curve) => at(curve, 0)), "")}
      ${row("to", `contrast at ${sign(angles[1], unit)}`, "At the last angle of the motion.", curves.map((curve) => at(curve, 1)), "")}
      ${ROWS.map(([key, name, unit, help]) => row(key, name, help, curves.map((curve) => of(curve, key)), unit))}
    </tbody>
  </table>`;
}
