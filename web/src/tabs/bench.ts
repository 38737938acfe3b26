// The tab of the bench: a rig is run and seen live; recordings become responses, diagnoses, calibrations and angles.
import { html, nothing, type TemplateResult } from "lit";
import { asked } from "../job";
import { legendOf, LivePlot, type Course } from "../live";
import { Tab, type Command, type Result } from "../tab";
import type { Values } from "../fields";

interface Running extends Command {
  live?: Course;
}

const SIMULATED = ["rotation", "bending", "press"] as const;
const RIGS = { rotation: "rig", bending: "rig-bending", press: "rig-press" };

class BenchTab extends Tab {
  readonly tab = "bench";
  private live: LivePlot | null = null;
  private asked = new Set<number>();

  protected hint(): string {
    return "Drop a recording, or write the files of a simulated rig and run it; two such files describe your own rig.";
  }

  take(job: Running): void {
    super.take(job);
    // the journal of a run can be decoded while it grows
    if (job.name === "bench run" && job.live && !this.asked.has(job.number)) {
      this.asked.add(job.number);
      void this.tried(async () => (this.kept = ((await asked(`tabs/${this.tab}`)) as { files: string[] }).files));
    }
  }

  protected stage(job: Running | undefined, result: Result | undefined): TemplateResult {
    if (!job?.live || job.files?.figure) return super.stage(job, result);
    return html`<div class="live" role="img" aria-label="${job.label}: ${job.live.axis} over time"></div>
      <ul class="legend" aria-label="Lines">${legendOf(job.live).map(([colour, name]) => html`<li><span class="line ${colour}"></span>${name}</li>`)}</ul>`;
  }

  protected updated(): void {
    const place = this.querySelector<HTMLElement>(".live");
    const course = (this.jobs.get(this.shown) as Running | undefined)?.live;
    if (!place || !course) return void (this.live = null);
    this.live ??= new LivePlot(place);
    this.live.show(course);
  }

  private next(name: string, values: Values): void {
    this.chosen = name;
    this.values = { ...this.values, [name]: { ...this.values[name], ...values } };
    void this.begin();
  }

  protected further(job: Command, _result: Result): TemplateResult | typeof nothing {
    const button = (words: string, name: string, values: Values) => html` <button type="button" @click=${() => this.next(name, values)}>${words}</button>`;
    if (job.name === "bench new")
      return html`<p>${SIMULATED.map((kind) => button(`Run the ${kind}`, "bench run", { protocol: `${job.folder}/${kind}.toml`, rig: `${job.folder}/${RIGS[kind]}.toml` }))}</p>`;
    const file = job.files?.recording && `${job.folder}/${job.files.recording.split(/[\\/]/).pop()}`;
    if (job.name === "bench run" && file)
      return html`<p>${button("Response", "bench analyse", { files: [file] })}${button("Diagnosis", "bench diagnose", { files: [file] })}${button("Calibrate", "bench calibrate", { recordings: [file] })}</p>`;
    if (job.name === "bench calibrate") {
      const calibration = Object.values(job.files ?? {}).find((path) => path.endsWith("calibration.json"));
      const recording = (this.values["bench calibrate"]?.recordings as string[] | undefined)?.[0];
      if (calibration && recording) return html`<p>${button("Angles", "bench decode", { calibration: `${job.folder}/calibration.json`, source: recording })}</p>`;
    }
    return nothing;
  }
}

customElements.define("solen-bench", BenchTab);
