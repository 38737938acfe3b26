// Controls of the design, made from its JSON Schema.
import { html, nothing, type TemplateResult } from "lit";
import { guard } from "lit/directives/guard.js";

// eslint-disable-next-line @typescript-eslint/no-explicit-any
export type Schema = Record<string, any>;
export type Values = Record<string, unknown>;
export type Change = (key: string, value: unknown, gesture?: string) => void;

const UNITS: [string, string][] = [
  ["um_per_px", "µm/px"], ["_mm_per_N", "mm/N"], ["_deg_per_s", "°/s"], ["_ms", "ms"], ["_V", "V"],
  ["_mW_per_cm2", "mW/cm²"], ["_mJ_per_cm2", "mJ/cm²"], ["_per_mm", "1/mm"], ["_percent", "%"], ["_px", "px"], ["_s", "s"], ["_mm2", "mm²"], ["_deg", "°"], ["_mm", "mm"], ["_nm", "nm"], ["_um", "µm"], ["_N", "N"], ["_MPa", "MPa"],
  ["_ohm", "Ω"], ["_ma", "mA"], ["_hz", "Hz"], ["_c", "°C"], ["_mw_cm2", "mW/cm²"], ["_v", "V"],
];
const FAR = 1e5; // a limit beyond is none that a person meets

// Names of options that are not words.
const LABELS: Record<string, string> = {
  threemf: "3MF", stl: "STL", glb: "GLB", dxf: "DXF", svg: "SVG", comsol: "COMSOL", step: "STEP", led: "LED",
  "": "size of a pixel", zero_u: "uncertainty of the zero", led_fwhm: "LED width at half height",
};

export function unitOf(key: string): string {
  return UNITS.find(([end]) => key.endsWith(end))?.[1] ?? "";
}

export function nameOf(key: string): string {
  if (/^u_./.test(key)) return `uncertainty of ${nameOf(key.slice(2))}`;
  const end = UNITS.find(([end]) => key.endsWith(end))?.[0] ?? "";
  const name = key.slice(0, key.length - end.length);
  return LABELS[name] ?? name.replaceAll("_", " ");
}

export function resolved(schema: Schema, root: Schema): Schema {
  if (!schema.$ref) return schema;
  const found = root.$defs[(schema.$ref as string).split("/").pop()!];
  return { ...found, ...schema, $ref: undefined };
}

function limits(schema: Schema): string {
  const words: string[] = [];
  const near = (value: number | undefined) => value !== undefined && Math.abs(value) < FAR;
  if (near(schema.minimum) && near(schema.maximum)) return `From ${schema.minimum} to ${schema.maximum}.`;
  if (near(schema.minimum)) words.push(`at least ${schema.minimum}`);
  if (near(schema.exclusiveMinimum)) words.push(`above ${schema.exclusiveMinimum}`);
  if (near(schema.maximum)) words.push(`at most ${schema.maximum}`);
  if (near(schema.exclusiveMaximum)) words.push(`below ${schema.exclusiveMaximum}`);
  return words.length ? `${words.join(", ")}.` : "";
}

export function stepOf(value: number): number {
  return value ? Math.min(10 ** (Math.floor(Math.log10(Math.abs(value))) - 1), 1) : 0.01;
}

function rounded(value: number, step: number): number {
  return +(Math.round(value / step) * step).toPrecision(12);
}

// A label that is dragged to change the number beside it.
function scrub(key: string, value: unknown, change: Change) {
  return (event: PointerEvent) => {
    if (typeof value !== "number" || event.button) return;
    const label = event.currentTarget as HTMLElement;
    const [start, step, gesture] = [event.clientX, stepOf(value), `scrub ${key} ${performance.now()}`];
    label.setPointerCapture(event.pointerId);
    let last = value;
    label.onpointermove = (move) => {
      const next = rounded(value + Math.round((move.clientX - start) / 3) * step, step);
      if (next !== last) change(key, (last = next), gesture);
    };
    label.onpointerup = label.onpointercancel = () => (label.onpointermove = null);
  };
}

function control(id: string, key: string, schema: Schema, value: unknown, rest: string, change: Change): TemplateResult {
  const help = `${id}-help`;
  if (schema.enum)
    return html`<select id=${id} data-shown=${String(value)} aria-describedby=${help} @change=${(e: Event) => change(key, (e.target as HTMLSelectElement).value || null)}>
      ${value === null || value === undefined ? html`<option value="" selected>default</option>` : nothing}
      ${(schema.enum as string[]).map((one) => html`<option .selected=${one === value}>${one}</option>`)}
    </select>`;
  if (schema.type === "boolean")
    return html`<input id=${id} type="checkbox" aria-describedby=${help} .checked=${!!value}
      @change=${(e: Event) => change(key, (e.target as HTMLInputElement).checked)}>`;
  if (schema.type === "number" || schema.type === "integer") {
    const step = schema.type === "integer" ? 1 : stepOf(typeof value === "number" ? value : 0);
    return html`<input id=${id} type="text" inputmode="decimal" autocomplete="off" role="spinbutton" aria-describedby=${help}
      aria-valuenow=${typeof value === "number" ? value : nothing} placeholder=${rest}
      data-shown=${value ?? ""} .value=${value === null || value === undefined ? "" : String(value)}
      @keydown=${(e: KeyboardEvent) => {
        const by = { ArrowUp: 1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[e.key];
        if (!by || typeof value !== "number") return;
        e.preventDefault();
        change(key, rounded(value + by * step, step), `keys ${key}`);
      }}
      @change=${(e: Event) => {
        const text = (e.target as HTMLInputElement).value.trim().replace(",", ".");
        change(key, text === "" ? (schema.default ?? null) : Number.isFinite(+text) ? +text : text);
      }}>`;
  }
  const text = value === null || value === undefined ? "" : typeof value === "string" ? value : JSON.stringify(value);
  return html`<input id=${id} type="text" autocomplete="off" aria-describedby=${help} placeholder=${rest} data-shown=${text} .value=${text}
    @change=${(e: Event) => {
      const typed = (e.target as HTMLInputElement).value.trim();
      let made: unknown = typed === "" ? (schema.default ?? null) : typed;
      if (/^[[{]/.test(typed))
        try {
          made = JSON.parse(typed);
        } catch {
          /* it stays text, and the refusal says what it must be */
        }
      change(key, made);
    }}>`;
}

// A row is made anew only when it shows something else: a drag changes one of a hundred.
export function row(table: string, name: string, schema: Schema, given: unknown, effective: Values, changed: boolean, change: Change): unknown {
  const key = table ? `${table}.${name}` : name;
  const shown = [key, JSON.stringify(given), effective[key], changed];
  return guard(shown, () => made(key, name, schema, given, effective, changed, change));
}

function made(key: string, name: string, schema: Schema, given: unknown, effective: Values, changed: boolean, change: Change): TemplateResult {
  const id = `field-${key}`;
  // a number that is left to a part or a resin is shown as what holds, in the place of one that is stated
  const left = key in effective;
  const value = left ? null : given;
  const words = [schema.description, limits(schema)].filter(Boolean).join(" ");
  const scrubbed = schema.type === "number" && typeof value === "number";
  return html`<div class="field ${changed ? "changed" : ""}">
    <label for=${id} class=${scrubbed ? "scrub" : ""} @pointerdown=${scrubbed ? scrub(key, value, change) : nothing}>${nameOf(name)}</label>
    ${control(id, key, schema, value, left ? `${+(effective[key] as number).toPrecision(6)}`.replace("NaN", String(effective[key])) : "default", change)}<span class="unit">${unitOf(name)}</span>
    <p class="help" id="${id}-help">${words}</p>
  </div>`;
}

// Show again what holds, after a change was refused.
export function restore(place: ParentNode): void {
  for (const one of place.querySelectorAll<HTMLInputElement | HTMLSelectElement>("[data-shown]"))
    if (one.value !== one.dataset.shown) one.value = one.dataset.shown!;
}

// All tables as groups, in the order of the file.
export function fields(root: Schema, values: Values, effective: Values, changed: Set<string>, change: Change, find: string): unknown[] {
  const own: unknown[] = [];
  const groups: TemplateResult[] = [];
  const wanted = (key: string) => !find || key.toLowerCase().includes(find.toLowerCase());
  for (const [table, given] of Object.entries(root.properties as Record<string, Schema>)) {
    if (table === "schema") continue;
    const schema = resolved(given, root);
    if (schema.type !== "object") {
      if (wanted(table)) own.push(row("", table, schema, values[table], effective, changed.has(table), change));
      continue;
    }
    const inside = (values[table] ?? {}) as Values;
    const rows = Object.entries(schema.properties as Record<string, Schema>)
      .filter(([name]) => wanted(`${table}.${name}`) || wanted(nameOf(name)))
      .map(([name, one]) => row(table, name, resolved(one, root), inside[name], effective, changed.has(`${table}.${name}`), change));
    if (rows.length)
      groups.push(html`<details ?open=${!!find || table === "lens" || table === "emitter"}>
        <summary>${table}</summary><p class="about">${given.description ?? schema.description}</p>${rows}
      </details>`);
  }
  return [...own.slice(0, 1), ...groups, ...own.slice(1)];
}
