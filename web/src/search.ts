// "Make it straighter": what a search is asked, how far it is, and its front as it grows. The search runs in the server.
import { html, nothing, svg, type TemplateResult } from "lit";
import { bar, type Job } from "./job";
import { measured } from "./merits";

export interface Sought {
  minimise: string[];
  maximise: string[];
  free: string[];
  subject_to: string[];
  robust: string[];
  as_printed: boolean;
  process: string | null;
  front: number;
  evaluations: number;
}

interface Row {
  number: number;
  goals: number[];
  u_goals: number[];
  values: Record<string, unknown>;
}

export interface Search extends Job {
  goals: string[];
  rows: Row[];
  before?: Row;
  warnings?: string[];
}

const [WIDTH, HEIGHT, EDGE] = [320, 190, 26];

// Places of the front's designs on a plot of one goal against the other.
function places(rows: Row[], before?: Row): [(row: Row) => [number, number], [number, number][]] {
  const all = before ? [...rows, before] : rows;
  const ends = [0, 1].map((axis): [number, number] => {
    const values = all.map((row) => row.goals[axis] ?? 0);
    return [Math.min(...values), Math.max(...values)];
  });
  const share = (value: number, [low, high]: [number, number]) => (high > low ? (value - low) / (high - low) : 0.5);
  return [
    ({ goals }) => [
      EDGE + share(goals[0], ends[0]) * (WIDTH - 2 * EDGE),
      HEIGHT - EDGE - share(goals[1] ?? 0, ends[1]) * (HEIGHT - 2 * EDGE),
    ],
    ends,
  ];
}

const short = (value: number) => `${+value.toPrecision(3)}`.replace("-", "−");

export function front({ rows, before, goals }: Search, chosen: number, take: (number: number) => void): TemplateResult {
  const [place, ends] = places(rows, before);
  const line = rows.map((row) => place(row).map((value) => value.toFixed(1)).join(","));
  const label = (x: number, y: number, words: string, anchor: string) => svg`<text x=${x} y=${y} text-anchor=${anchor}>${words}</text>`;
  return html`<svg class="front" viewBox="0 0 ${WIDTH} ${HEIGHT}" role="img" aria-label="The front: ${rows.length} designs, ${goals.join(" against ")}">
      <path d="M${EDGE} ${EDGE / 2}V${HEIGHT - EDGE + 8}H${WIDTH - EDGE / 2}"></path>
      <polyline points=${line.join(" ")}></polyline>
      ${rows.map((row) => {
        const [x, y] = place(row);
        return svg`<circle class=${row.number === chosen ? "chosen" : ""} cx=${x} cy=${y} r="5" @click=${() => take(row.number)}></circle>`;
      })}
      ${before ? svg`<rect x=${place(before)[0] - 4} y=${place(before)[1] - 4} width="8" height="8"></rect>` : nothing}
      ${label(EDGE, HEIGHT - 4, short(ends[0][0]), "start")} ${label(WIDTH - EDGE / 2, HEIGHT - 4, short(ends[0][1]), "end")}
      ${label(WIDTH / 2, HEIGHT - 4, goals[0], "middle")}
      ${label(EDGE + 5, 12, `${goals[1] ?? ""}${goals[1] ? ` up to ${short(ends[1][1])}` : ""}`, "start")}
    </svg>
    <table class="merits designs">
      <thead><tr><th scope="col">Design</th>${goals.map((goal) => html`<th scope="col">${goal}</th>`)}</tr></thead>
      <tbody>
        ${before ? html`<tr><th scope="row">□ before</th>${cells(before)}</tr>` : nothing}
        ${rows.map((row) => html`<tr><th scope="row"><button type="button" aria-pressed=${String(row.number === chosen)}
          title=${Object.entries(row.values).map(([key, value]) => `${key} = ${value}`).join("\n")} @click=${() => take(row.number)}>Open ${row.number}</button></th>${cells(row)}</tr>`)}
      </tbody>
    </table>`;
}

const cells = (row: Row) => row.goals.map((goal, i) => html`<td>${measured(goal, row.u_goals[i])}</td>`);

// What the search is asked, in the words of its command.
export function asked(sought: Sought, running: boolean, begin: (sought: Sought) => void): TemplateResult {
  const lines = (name: keyof Sought, words: string, rows: number) => html`<label>${words}
    <textarea name=${name} rows=${rows} spellcheck="false" .value=${(sought[name] as string[]).join("\n")}></textarea></label>`;
  const submit = (event: Event) => {
    event.preventDefault();
    const given = new FormData(event.target as HTMLFormElement);
    const list = (name: string) => String(given.get(name)).split("\n").map((line) => line.trim()).filter(Boolean);
    begin({
      ...sought, minimise: list("minimise"), maximise: list("maximise"), free: list("free"), subject_to: list("subject_to"),
      robust: list("robust"), as_printed: given.has("as_printed"), process: String(given.get("process")).trim() || null,
      evaluations: Math.round(+String(given.get("evaluations"))) || sought.evaluations,
    });
  };
  return html`<form class="sought" @submit=${submit}>
    ${lines("minimise", "Make small", 1)} ${lines("maximise", "Make large", 1)}
    ${lines("free", "Free parameters, KEY=LOW:HIGH", 5)} ${lines("subject_to", "What must hold", 2)}
    ${lines("robust", "Deviations to tolerate, KEY=DEVIATION", 2)}
    <label>Process file of the printer, in the design's folder <input name="process" type="text" autocomplete="off" .value=${sought.process ?? ""}></label>
    <label class="checked"><input name="as_printed" type="checkbox" .checked=${sought.as_printed}> Each design as this process prints it</label>
    <label>Designs tried <input name="evaluations" type="number" min="20" max="100000" .value=${String(sought.evaluations)}></label>
    <button type="submit" class="main" ?disabled=${running}>Begin</button>
  </form>`;
}

const STATES = {
  running: "The current front, with the accuracy of the search.",
  done: "The front, traced again with a tenth of the tolerance.",
  cancelled: "Cancelled: the current front, not traced again. The same search continues from here.",
  failed: "",
};

export function progress(search: Search): TemplateResult {
  return html`${bar(search, "the search")}
    <p class="quality">${search.state === "running" && search.share >= 1 ? "Tracing the front again with a smaller tolerance …" : STATES[search.state]}
      Responses are kept in ${search.folder}.</p>
    ${search.why ? html`<p class="warning" role="alert">${search.why}</p>` : nothing}
    ${(search.warnings ?? []).map((words) => html`<p class="warning">${words}</p>`)}`;
}
