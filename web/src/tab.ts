// A tab beside the design: files are dropped, a command is begun on them, and what it prints is shown. No number is made here.
import { html, LitElement, nothing, type TemplateResult } from "lit";
import { copied, give } from "./copied";
import type { Values } from "./fields";
import { form, missing, type Offer } from "./form";
import { asked, bar, Refused, type Job } from "./job";
import type { Request } from "./link";
import { table, type Plain } from "./result";

export interface Command extends Job {
  label: string;
  python: string;
  lines?: string[];
  files?: Record<string, string>;
}

export interface Host {
  readonly file: string;
  ask(request: Request): void;
}

interface Dropped {
  name: string;
  suits: string[];
  why: string;
}

export type Result = { [key: string]: Plain };

export abstract class Tab extends LitElement {
  abstract readonly tab: string;
  host!: Host;
  protected offers: Offer[] = [];
  protected kept: string[] = [];
  protected values: Record<string, Values> = {};
  protected chosen = "";
  protected jobs = new Map<number, Command>();
  protected results = new Map<number, Result>();
  protected shown = 0;
  protected refused = "";
  private over = false;
  private busy = "";

  protected createRenderRoot(): HTMLElement {
    return this;
  }

  connectedCallback(): void {
    super.connectedCallback();
    this.addEventListener("dragover", (event) => (event.preventDefault(), this.hovers(true)));
    this.addEventListener("dragleave", () => this.hovers(false));
    this.addEventListener("drop", (event) => {
      event.preventDefault();
      this.hovers(false);
      void this.drop([...(event.dataTransfer?.files ?? [])]);
    });
    void this.open();
  }

  private hovers(over: boolean): void {
    if (over === this.over) return;
    this.over = over;
    this.requestUpdate();
  }

  // What the server answers; a refusal is shown, and nothing follows.
  protected async tried<T>(step: () => Promise<T>): Promise<T | undefined> {
    try {
      this.refused = "";
      return await step();
    } catch (bad) {
      if (!(bad instanceof Refused)) throw bad;
      this.refused = bad.message;
      return undefined;
    } finally {
      this.requestUpdate();
    }
  }

  private async open(): Promise<void> {
    const found = (await this.tried(() => asked(`tabs/${this.tab}`))) as { offers: Offer[]; files: string[] } | undefined;
    if (!found) return;
    this.offers = found.offers;
    this.kept = found.files;
    this.chosen ||= this.offers[0].name;
    for (const job of this.jobs.values()) if (!this.offer(job.name)) this.jobs.delete(job.number);
    this.show(Math.max(0, ...this.jobs.keys()));
  }

  protected offer(name: string): Offer | undefined {
    return this.offers.find((one) => one.name === name);
  }

  // News of a job; jobs of other tabs are left alone.
  take(job: Command): void {
    if (this.offers.length && !this.offer(job.name)) return;
    const before = this.jobs.get(job.number);
    this.jobs.set(job.number, job);
    if (before?.state === "running" && job.state === "done") this.kept = [...new Set([...this.kept, ...this.written(job)])];
    if (job.number === this.shown) this.show(job.number);
    this.requestUpdate();
  }

  private written(job: Command): string[] {
    return Object.values(job.files ?? {}).map((path) => `${job.folder}/${path.split(/[\\/]/).pop()}`).filter((name) => /\.(json|toml|nc)$/.test(name));
  }

  protected show(number: number): void {
    this.shown = number;
    const job = this.jobs.get(number);
    if (job?.state === "done" && !this.results.has(number))
      void this.tried(async () => this.results.set(number, (await asked(`jobs/${number}`)) as Result));
    this.requestUpdate();
  }

  protected async drop(files: File[]): Promise<void> {
    for (const file of files) {
      this.busy = file.name;
      this.requestUpdate();
      const found = (await this.tried(() => asked(`files/${this.tab}/${encodeURIComponent(file.name)}`, "PUT", file))) as Dropped | undefined;
      this.busy = "";
      if (!found) return;
      this.kept = [...new Set([...this.kept, found.name])];
      if (found.why) this.refused = found.why;
      else this.given(found);
    }
    this.requestUpdate();
  }

  // A dropped file is given to the command that it suits, which begins if nothing is missing.
  protected given({ name, suits }: Dropped): void {
    this.chosen = suits.includes(this.chosen) ? this.chosen : suits[0];
    const offer = this.offer(this.chosen)!;
    const field = offer.files[0];
    if (!field) return this.requestUpdate(); // an option takes it
    const before = (this.values[offer.name]?.[field.name] ?? []) as string[];
    this.set(field.name, field.many ? [...new Set([...before, name])] : name);
    if (!missing(offer, this.values[offer.name]).length) void this.begin();
  }

  // A command that takes results only gets the newest of each.
  private newest(offer: Offer): void {
    if (!offer.files.length || offer.files.some((one) => !one.result)) return;
    const numberOf = (name: string) => +name.split("/")[0].split("-").pop()!;
    const found = offer.files.map(({ name }): [string, string | undefined] => {
      const own = this.kept.filter((one) => one.endsWith(`/${name}.json`)).sort((a, b) => numberOf(a) - numberOf(b));
      return [name, this.values[offer.name]?.[name] as string | undefined ?? own.pop()];
    });
    this.values = { ...this.values, [offer.name]: { ...this.values[offer.name], ...Object.fromEntries(found) } };
  }

  protected choose(name: string): void {
    this.chosen = name;
    this.newest(this.offer(name)!);
    this.requestUpdate();
  }

  protected set(name: string, value: unknown): void {
    this.values = { ...this.values, [this.chosen]: { ...this.values[this.chosen], [name]: value } };
    this.requestUpdate();
  }

  protected async begin(): Promise<void> {
    const order = { command: this.chosen, asked: this.values[this.chosen] ?? {} };
    const job = (await this.tried(() => asked("jobs", "POST", JSON.stringify(order)))) as Command | undefined;
    if (!job) return;
    if (!this.jobs.has(job.number)) this.jobs.set(job.number, job);
    this.show(job.number);
  }

  // What stands in the middle; the figure of the command unless a tab has better.
  protected stage(job: Command | undefined, _result: Result | undefined): TemplateResult {
    const figure = job?.files?.figure && `jobs/${job.number}/figure`;
    return figure ? html`<img class="figure" src=${figure} alt="${job.label}: ${(job.lines ?? []).join("; ")}">` : html`<p class="empty">${this.hint()}</p>`;
  }

  protected abstract hint(): string;

  // What a tab adds below the numbers.
  protected further(_job: Command, _result: Result): TemplateResult | typeof nothing {
    return nothing;
  }

  private async png(job: Command): Promise<void> {
    const image = new Image();
    image.src = `jobs/${job.number}/figure`;
    await image.decode();
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [2 * image.naturalWidth, 2 * image.naturalHeight];
    canvas.getContext("2d")!.drawImage(image, 0, 0, canvas.width, canvas.height);
    canvas.toBlob((blob) => blob && give(blob, `${job.folder}.png`));
  }

  private inputs(): TemplateResult {
    const offer = this.offer(this.chosen);
    const running = [...this.jobs.values()].some((job) => job.name === this.chosen && job.state === "running");
    return html`<div class="drop ${this.over ? "over" : ""}">
        <label class="file">${this.busy ? `Reading ${this.busy} …` : "Drop a file here, or choose one"}
          <input type="file" multiple @change=${(event: Event) => {
            const input = event.target as HTMLInputElement;
            void this.drop([...(input.files ?? [])]).then(() => (input.value = ""));
          }}></label>
      </div>
      ${this.refused ? html`<p class="warning refusal" role="alert">${this.refused}</p>` : nothing}
      <label class="command">Command <select .value=${this.chosen} @change=${(event: Event) => this.choose((event.target as HTMLSelectElement).value)}>${this.offers.map((one) => html`<option value=${one.name} .selected=${one.name === this.chosen}>${one.label}</option>`)}</select></label>
      ${offer ? form(offer, this.values[offer.name] ?? {}, this.kept, (name, value) => this.set(name, value), () => void this.begin(), running) : nothing}
      ${this.jobs.size ? html`<h2>Results</h2><ul class="jobs">${[...this.jobs.values()].reverse().map((job) => html`<li><button type="button" aria-pressed=${String(job.number === this.shown)}
        @click=${() => this.show(job.number)}>${job.label} <span class="unit">${job.folder}, ${job.state}</span></button></li>`)}</ul>` : nothing}`;
  }

  private answer(job: Command, result: Result | undefined): TemplateResult {
    const files = Object.entries(job.files ?? {}).filter(([name]) => name !== "figure");
    return html`<h2>${job.label}</h2>
      ${job.state === "running" ? bar(job, job.label) : nothing}
      ${job.why ? html`<p class="warning" role="alert">${job.why}</p>` : nothing}
      ${job.state === "cancelled" ? html`<p class="quality">Cancelled.</p>` : nothing}
      <div class="lines">${(job.lines ?? []).map((line) => html`<p>${line}</p>`)}</div>
      ${((result?.warnings ?? []) as string[]).map((words) => html`<p class="warning">${words}</p>`)}
      ${job.files ? html`<p class="kept">${job.files.figure ? html`Figure as <a href="jobs/${job.number}/figure" download="${job.folder}.svg">SVG</a>
        <button type="button" @click=${() => void this.png(job)}>PNG</button>` : nothing}
        ${files.map(([name, path]) => html` <a href="jobs/${job.number}/${name}" download>${path.split(/[\\/]/).pop()}</a>`)}</p>` : nothing}
      ${result ? this.further(job, result) : nothing}
      ${result ? table(result) : nothing}
      <details class="same"><summary>The same elsewhere</summary>
        ${copied("The same from the command line", job.shell)} ${copied("The same in Python", job.python)}</details>`;
  }

  protected render(): TemplateResult {
    const job = this.jobs.get(this.shown);
    const result = this.results.get(this.shown);
    return html`<section class="design inputs" aria-label="Files and options">${this.inputs()}</section>
      <section class="sketch" aria-label="Figure">${this.stage(job, result)}</section>
      <section class="answer" aria-label="Numbers" aria-live="polite">${job ? this.answer(job, result) : nothing}</section>`;
  }
}
