// The form of an offered command, made from what its function takes.
import { html, nothing, type TemplateResult } from "lit";
import { row, type Schema, type Values } from "./fields";

export interface FileField {
  name: string;
  label: string;
  many: boolean;
  required: boolean;
  result: boolean; // a file that another command wrote
}

export interface Offer {
  name: string;
  label: string;
  help: string;
  design: boolean;
  files: FileField[];
  first: string[];
  fields: Record<string, Schema>;
  required: string[];
}

// Names that are missing before the command can begin.
export function missing(offer: Offer, values: Values): string[] {
  const empty = (name: string) => values[name] === undefined || values[name] === null || values[name] === "" || (Array.isArray(values[name]) && !(values[name] as unknown[]).length);
  return [...offer.files.filter((one) => one.required).map((one) => one.name), ...offer.required].filter(empty);
}

function fileField(offer: Offer, field: FileField, value: unknown, all: string[], set: (name: string, value: unknown) => void): TemplateResult {
  const kept = all.filter((name) => (field.result ? /\.(json|toml)$/.test(name) : !name.includes("/") || /\.(nc|journal)$/.test(name)));
  if (!field.many) {
    return html`<label class="filed">${field.label}
      <select name=${field.name} @change=${(e: Event) => set(field.name, (e.target as HTMLSelectElement).value)}>
        <option value="" .selected=${!value}>${field.required ? "drop a file" : "none"}</option>
        ${kept.map((name) => html`<option .selected=${name === value}>${name}</option>`)}
      </select></label>`;
  }
  const chosen = (value ?? []) as string[];
  return html`<fieldset class="filed"><legend>${field.label}</legend>
    ${kept.length ? kept.map((name) => html`<label><input type="checkbox" name=${`${offer.name} ${field.name}`} .checked=${chosen.includes(name)}
      @change=${(e: Event) => set(field.name, (e.target as HTMLInputElement).checked ? [...chosen, name] : chosen.filter((one) => one !== name))}> ${name}</label>`) : html`<span class="unit">drop a file</span>`}
  </fieldset>`;
}

export function form(offer: Offer, values: Values, kept: string[], set: (name: string, value: unknown) => void, begin: () => void, running: boolean): TemplateResult {
  const lists = (schema: Schema, value: unknown) => (schema.type === "array" && typeof value === "string" ? value.split(/[,;\n]+/).map((one) => one.trim()).filter(Boolean) : value);
  const field = (name: string) => {
    const schema = offer.fields[name];
    if (schema.format === "path") return fileField(offer, { name, label: name.replaceAll("_", " "), many: false, required: false, result: true }, values[name], kept, set);
    const shown = Array.isArray(values[name]) ? (values[name] as unknown[]).join(", ") : values[name];
    const given = shown ?? (Array.isArray(schema.default) ? (schema.default as unknown[]).join(", ") : schema.default);
    return row(offer.name.replaceAll(" ", "-"), name, { ...schema, default: null }, given, {}, values[name] !== undefined && values[name] !== null, (_, value) => set(name, lists(schema, value)));
  };
  const later = Object.keys(offer.fields).filter((name) => !offer.first.includes(name));
  const lacks = missing(offer, values);
  return html`<form @submit=${(event: Event) => (event.preventDefault(), begin())}>
    <p class="about">${offer.help}</p>
    ${offer.files.map((one) => fileField(offer, one, values[one.name], kept, set))}
    ${offer.first.map(field)}
    ${later.length ? html`<details><summary>All options</summary>${later.map(field)}</details>` : nothing}
    <p class="begin"><button type="submit" class="main" ?disabled=${running}>${running ? "Running …" : "Begin"}</button>
      ${lacks.length ? html`<span class="unit">needs ${lacks.map((one) => one.replaceAll("_", " ")).join(", ")}</span>` : nothing}</p>
  </form>`;
}
