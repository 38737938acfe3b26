// The tab of the microscope: an image of a printed lens is measured; a scale bar or two marks are clicked on it.
import { html, nothing, type TemplateResult } from "lit";
import { Tab, type Command, type Result } from "../tab";

type Place = [number, number];
const ARROWS: Record<string, Place> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

class MicroscopeTab extends Tab {
  readonly tab = "microscope";
  private marks: Place[] = []; // in pixels of the image
  private length = "";
  private size: Place = [1, 1];
  private imageShown = true;

  protected hint(): string {
    return "Drop a micrograph of a printed lens, seen along y. Its scale is read from the file, or from the two ends of a scale bar that you click.";
  }

  private get name(): string {
    return (this.values[this.chosen]?.image as string | undefined) ?? "";
  }

  protected show(number: number): void {
    this.imageShown = false;
    super.show(number);
  }

  // The command takes the ends of the bar and its length; the size of a pixel is computed there.
  private stated(): void {
    const length = +this.length.replace(",", ".");
    const complete = this.marks.length === 2 && length > 0;
    this.values = { ...this.values, "print inspect": { ...this.values["print inspect"], bar: complete ? [...this.marks.flat(), length] : null } };
    this.requestUpdate();
  }

  private mark(event: MouseEvent): void {
    const box = (event.currentTarget as HTMLElement).getBoundingClientRect();
    const place: Place = [(event.clientX - box.left) / box.width * this.size[0], (event.clientY - box.top) / box.height * this.size[1]].map((one) => +one.toFixed(1)) as Place;
    this.marks = this.marks.length === 2 ? [place] : [...this.marks, place];
    this.stated();
  }

  private nudge(event: KeyboardEvent, i: number): void {
    const by = ARROWS[event.key];
    if (!by) return;
    event.preventDefault();
    const step = event.shiftKey ? 10 : 1;
    this.marks = this.marks.map((mark, k) => (k === i ? [mark[0] + step * by[0], mark[1] + step * by[1]] : mark)) as Place[];
    this.stated();
  }

  private begun(): void {
    this.marks = this.marks.length ? [] : [[0.25 * this.size[0], 0.9 * this.size[1]], [0.75 * this.size[0], 0.9 * this.size[1]]];
    this.stated();
  }

  protected stage(job: Command | undefined, result: Result | undefined): TemplateResult {
    if (!this.name) return super.stage(job, result);
    const toggle = html`<div class="tools"><fieldset class="choice"><legend>Show</legend>
      <button type="button" aria-pressed=${String(this.imageShown)} @click=${() => ((this.imageShown = true), this.requestUpdate())}>image</button>
      <button type="button" aria-pressed=${String(!this.imageShown)} @click=${() => ((this.imageShown = false), this.requestUpdate())}>result</button></fieldset>
      ${this.imageShown ? html`<label class="rays">Distance of the marks <input name="bar" inputmode="decimal" .value=${this.length} @change=${(e: Event) => ((this.length = (e.target as HTMLInputElement).value), this.stated())}> µm</label>
        <button type="button" @click=${() => this.begun()}>${this.marks.length ? "Remove the marks" : "Set two marks"}</button>` : nothing}</div>`;
    if (!this.imageShown) return html`${toggle}${super.stage(job, result)}`;
    const where = (i: number) => `left: ${100 * this.marks[i][0] / this.size[0]}%; top: ${100 * this.marks[i][1] / this.size[1]}%`;
    return html`${toggle}<div class="micrograph"><div class="framed">
      <img src="images/${this.name.split("/").map(encodeURIComponent).join("/")}" alt="The micrograph ${this.name}"
        @load=${(e: Event) => ((this.size = [(e.target as HTMLImageElement).naturalWidth, (e.target as HTMLImageElement).naturalHeight]), this.requestUpdate())} @click=${(e: MouseEvent) => this.mark(e)}>
      ${this.marks.map((_, i) => html`<button type="button" class="handle mark" id="mark-${i}" .style=${where(i)} aria-label="Mark ${i + 1}: arrow keys move it by a pixel" @keydown=${(e: KeyboardEvent) => this.nudge(e, i)}></button>`)}
    </div></div>
    <output class="coordinates">${this.marks.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)} px`).join("   ")}</output>`;
  }

  protected further(job: Command, _result: Result): TemplateResult | typeof nothing {
    if (job.name !== "print inspect") return nothing;
    const profile = `${this.host.file.replace(/\.toml$/, "")}-studio/${job.folder}/lens.json`;
    return html`<p><button type="button" class="main" @click=${() => this.host.ask({ values: { "lens.shape": "measured", "lens.profile": profile }, gesture: `lens of ${job.folder}` })}>Use as the lens</button></p>`;
  }
}

customElements.define("solen-microscope", MicroscopeTab);
