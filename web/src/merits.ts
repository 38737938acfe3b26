// The numbers of a response, with their uncertainties.
import { html, type TemplateResult } from "lit";
import type { Curve } from "./response";

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
  ["slope_per_deg", "slope at the null", "1/°", "Change of the contrast with the angle where both receivers get the same light."],
  ["null_deg", "null", "°", "Angle at which both receivers get the same light."],
  ["span", "span", "", "Contrast at the last angle less that at the first."],
  ["linearity_percent", "off a line", "%", "Largest deviation from the best straight line, in percent of the span."],
  ["range_deg", "range", "°", "Range about the null over which the contrast only rises or only falls."],
  ["light", "light", "", "Least share of the emitted power at both receivers together."],
  ["resolution_deg", "resolution", "°", "Standard deviation of an angle from one reading, where it is worst."],
];

export function merits(own: Curve | undefined, flat: Curve | undefined | null, angles: [number, number], unit: string): TemplateResult {
  const at = (curve: Curve | undefined | null, end: number) => (curve ? measured(curve.head.ends[end], curve.head.u_ends[end]) : "–");
  const row = (id: string, name: string, help: string, values: string[], unit: string) => html`<tr id="merit-${id}">
    <th scope="row" title=${help}>${name}${unit ? html` <span class="unit">${unit}</span>` : ""}</th>${(flat !== null ? values : values.slice(0, 1)).map((value) => html`<td>${value}</td>`)}
  </tr>`;
  const of = (curve: Curve | undefined | null, key: string) => measured(curve?.head.merits?.[key], curve?.head.merits?.[`u_${key}`]);
  return html`<table class="merits">
    <thead><tr><th scope="col">Merit</th><th scope="col">design</th>${flat !== null ? html`<th scope="col">no lens</th>` : ""}</tr></thead>
    <tbody>
      ${row("from", `contrast at ${sign(angles[0], unit)}`, "At the first angle of the motion.", [at(own, 0), at(flat, 0)], "")}
      ${row("to", `contrast at ${sign(angles[1], unit)}`, "At the last angle of the motion.", [at(own, 1), at(flat, 1)], "")}
      ${ROWS.map(([key, name, unit, help]) => row(key, name, help, [of(own, key), of(flat, key)], unit))}
    </tbody>
  </table>`;
}
