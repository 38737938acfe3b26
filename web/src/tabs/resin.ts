// The tab of the resin: spectra, discs and guides become numbers of a resin, and a resin file.
import { html, nothing, type TemplateResult } from "lit";
import { Tab, type Command, type Result } from "../tab";

class ResinTab extends Tab {
  readonly tab = "resin";

  protected hint(): string {
    return "Drop a spectrum of a layer, a table of cured discs or of guides: the kind is detected automatically.";
  }

  protected further(job: Command, result: Result): TemplateResult | typeof nothing {
    if (job.name === "resin build") {
      const file = job.files!.resin.split(/[\\/]/).pop()!;
      return html`<p><button type="button" class="main" @click=${() => this.host.ask({ values: { "material.index": null, "material.resin": file } })}>Use in this design</button></p>`;
    }
    const saved = this.offer("resin build")!.files.some((one) => job.name === `resin ${one.name}`);
    return saved && result ? html`<p><button type="button" @click=${() => this.choose("resin build")}>Save as a resin</button></p>` : nothing;
  }
}

customElements.define("solen-resin", ResinTab);
