// The tab of the print: the part as a solid, its layers one by one with their exposures, a predicted print, the next drawing.
import { html, nothing, type TemplateResult } from "lit";
import { asked } from "../job";
import { Part } from "../part";
import { Tab, type Command, type Result } from "../tab";

interface Layer {
  file: string;
  from_mm: number;
  to_mm: number;
  exposure_s: number;
  dose_mJ_per_cm2: number;
  area_mm2: number;
}

const MARGIN = 12; // pixels about the part

class PrintTab extends Tab {
  readonly tab = "print";
  private seen: Part | null = null;
  private layers: Layer[] = [];
  private of = 0; // job whose part or layers are shown
  private at = 0;
  private box = [Infinity, Infinity, -Infinity, -Infinity]; // of what is lit in the layers seen so far
  private drawn = 0;

  protected hint(): string {
    return "Begin with the solid and the layers of the open design. Drop a micrograph of its print here to compute the next drawing.";
  }

  private layered(job: Command | undefined): boolean {
    return !!job?.files?.layers?.endsWith(".zip");
  }

  protected stage(job: Command | undefined, result: Result | undefined): TemplateResult {
    if (job?.name === "export" && job.files?.stl)
      return html`<div class="stage"><canvas class="part" tabindex="0" role="img" aria-label="The part in space: drag or arrow keys turn it, wheel or plus and minus zoom"></canvas></div>
        <p class="quality">Drag or arrow keys turn the part, wheel or + and − zoom.</p>`;
    if (!this.layered(job)) return super.stage(job, result);
    const layer = this.of === job!.number ? this.layers[this.at] : undefined;
    return html`<div class="stage"><canvas class="layer" role="img" aria-label="Exposure image of layer ${this.at + 1}"></canvas></div>
      <div class="angle"><label for="layer">Layer</label>
        <input id="layer" type="range" min="1" max=${Math.max(this.layers.length, 1)} step="1" .value=${String(this.at + 1)}
          @input=${(event: Event) => this.turnTo(+(event.target as HTMLInputElement).value - 1)}>
        <output>${this.at + 1} of ${this.layers.length}</output></div>
      <p class="quality exposed">${layer ? `${layer.from_mm.toFixed(3)} to ${layer.to_mm.toFixed(3)} mm, exposed for ${+layer.exposure_s.toPrecision(4)} s${layer.dose_mJ_per_cm2 ? ` (${+layer.dose_mJ_per_cm2.toPrecision(4)} mJ/cm²)` : ""}, ${+layer.area_mm2.toPrecision(4)} mm²` : "…"}</p>`;
  }

  protected further(job: Command): TemplateResult | typeof nothing {
    return job.name === "print layers" && job.files?.figure
      ? html`<p><a href="jobs/${job.number}/figure" target="_blank">Figure of the layers</a></p>`
      : nothing;
  }

  protected updated(): void {
    const job = this.jobs.get(this.shown);
    if (job?.state !== "done" || this.of === job.number) return;
    if (job.name === "export" && job.files?.stl) {
      this.of = job.number;
      void this.solid(job);
    } else if (this.layered(job)) {
      this.of = job.number;
      void this.stack(job);
    } else this.of = 0;
  }

  private async solid(job: Command): Promise<void> {
    const data = await (await fetch(`jobs/${job.number}/stl`)).arrayBuffer();
    this.seen?.end();
    this.seen = new Part(this.querySelector<HTMLCanvasElement>("canvas.part")!, data);
  }

  private async stack(job: Command): Promise<void> {
    const found = (await this.tried(() => asked(`jobs/${job.number}/layers/job.json`))) as { layers: Layer[] } | undefined;
    this.layers = found?.layers ?? [];
    this.box = [Infinity, Infinity, -Infinity, -Infinity];
    this.turnTo(Math.floor(this.layers.length / 2));
  }

  private turnTo(at: number): void {
    this.at = at;
    this.requestUpdate();
    void this.drawLayer(this.of, at);
  }

  // The image of a layer around its lit pixels, in whole pixels of the printer.
  private async drawLayer(job: number, at: number): Promise<void> {
    if (!this.layers[at]) return;
    const number = ++this.drawn;
    const answer = await fetch(`jobs/${job}/layers/${this.layers[at].file}`);
    const image = await createImageBitmap(await answer.blob());
    if (number !== this.drawn) return; // a newer one is asked for
    const canvas = this.querySelector<HTMLCanvasElement>("canvas.layer")!;
    const whole = new OffscreenCanvas(image.width, image.height).getContext("2d", { willReadFrequently: true })!;
    whole.drawImage(image, 0, 0);
    const { data } = whole.getImageData(0, 0, image.width, image.height);
    let [left, top, right, bottom] = this.box;
    for (let y = 0, i = 0; y < image.height; y++)
      for (let x = 0; x < image.width; x++, i += 4)
        if (data[i]) [left, top, right, bottom] = [Math.min(left, x), Math.min(top, y), Math.max(right, x), Math.max(bottom, y)];
    this.box = [left, top, right, bottom];
    if (right < left) return;
    const [x, y] = [Math.max(left - MARGIN, 0), Math.max(top - MARGIN, 0)];
    [canvas.width, canvas.height] = [Math.min(right + MARGIN + 1, image.width) - x, Math.min(bottom + MARGIN + 1, image.height) - y];
    canvas.getContext("2d")!.drawImage(image, -x, -y);
    canvas.dataset.layer = String(at + 1);
  }
}

customElements.define("solen-print", PrintTab);
