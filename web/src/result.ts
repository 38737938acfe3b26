// A result as the command states it with --json: each number by its name, with its uncertainty.
import { html, nothing, type TemplateResult } from "lit";
import { measured } from "./merits";

export type Plain = null | boolean | number | string | Plain[] | { [key: string]: Plain };

const APART = new Set(["warnings", "sources", "files"]);
const [MOST_ROWS, MOST_TABLES] = [120, 4];
const DIGITS = 9; // more than a command's lines show; the title holds all

// A name that may go on in the next line after a part of it, not within a word.
const parted = (name: string) => name.split(/(?<=[_.\]])/).map((part) => html`${part}<wbr>`);
const exact = (value: Plain, u: Plain) => (typeof u === "number" ? `${value} ± ${u}` : String(value));

function range(values: Plain[]): string {
  const numbers = values.filter((one): one is number => typeof one === "number");
  if (numbers.length < values.length || numbers.length < 4) return values.map((one) => inWords(one, null)).join(", ");
  const [low, high] = [Math.min(...numbers), Math.max(...numbers)];
  return `${inWords(low, null)} to ${inWords(high, null)} (${numbers.length})`;
}

function inWords(value: Plain, u: Plain): string {
  if (value === null) return "–";
  if (typeof value === "number") return u === null ? `${+value.toPrecision(DIGITS)}`.replace("-", "−") : measured(value, u as number | null);
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (Array.isArray(value)) return value.length > 400 ? `${value.length} values` : range(value);
  return String(value);
}

const isTable = (value: Plain): value is { [key: string]: Plain } => value !== null && typeof value === "object" && !Array.isArray(value);

// Rows of a table: names as of the result, nested ones with dots.
export function* rows(result: { [key: string]: Plain }, within = ""): Generator<[string, Plain, Plain]> {
  for (const [name, value] of Object.entries(result)) {
    if ((!within && APART.has(name)) || (name.startsWith("u_") && name.slice(2) in result)) continue;
    if (isTable(value)) yield* rows(value, `${within}${name}.`);
    else if (Array.isArray(value) && value.some(isTable)) {
      if (value.length > MOST_TABLES) yield [within + name, `${value.length} rows, in the file`, null];
      else for (const [i, one] of value.entries()) if (isTable(one)) yield* rows(one, `${within}${name}[${i}].`);
    } else yield [within + name, value, result[`u_${name}`] ?? null];
  }
}

export function table(result: { [key: string]: Plain }): TemplateResult {
  const all = [...rows(result)].filter(([, value]) => value !== null && value !== "" && !(Array.isArray(value) && !value.length));
  return html`<table class="merits values">
    <thead><tr><th scope="col">As with --json</th><th scope="col">value</th></tr></thead>
    <tbody>${all.slice(0, MOST_ROWS).map(([name, value, u]) => html`<tr data-name=${name}>
      <th scope="row">${parted(name)}</th><td title=${typeof value === "number" ? exact(value, u) : nothing}>${inWords(value, u)}</td></tr>`)}</tbody>
  </table>
  ${all.length > MOST_ROWS ? html`<p class="quality">${all.length - MOST_ROWS} more are in the result's file.</p>` : nothing}`;
}
