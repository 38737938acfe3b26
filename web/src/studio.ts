// The page: it shows what the server sends, and asks for what a person does. No physics is computed here.
import { html, LitElement, nothing, type TemplateResult } from "lit";
import { copied, give } from "./copied";
import { Drawing, type Colouring, type Picture } from "./drawing";
import { fields, nameOf, restore, unitOf, type Schema, type Values } from "./fields";
import type { Frame } from "./frames";
import { Link, type Request, type View } from "./link";
import { measured, merits, powers, sign, type Powers } from "./merits";
import { asked, front, progress, type Search, type Sought } from "./search";
import type { Command, Host, Tab } from "./tab";
import { curveOf, ResponsePlot, type Band, type Curve, type Name } from "./response";

const HANDLES: Record<string, [string, string]> = {
  turn: ["Turn the lens", "arrow keys turn by 0.1°"],
  emitter: ["Emitter", "arrow keys move it by 0.01 mm"],
  pivot: ["Pivot of the motion", "arrow keys move it by 0.05 mm"],
  arm: ["End of the arm", "arrow keys move it by 0.1 mm"],
  node: ["Node", "arrow keys move it by 0.1 mm"],
  through: ["Point of the guide", "arrow keys move it by 0.1 mm"],
  lens: ["Lens", "arrow keys move it by 0.1 mm along its side"],
  receiver: ["Receiver", "arrow keys move it by 0.1 mm along its side"],
};
// Kind of a handle, and which of its kind: "arm-right" is the right arm.
const kindOf = (name: string) => name.split("-")[0];
const handled = (name: string): [string, string] => {
  const [words, keys] = HANDLES[kindOf(name)];
  const which = name.slice(kindOf(name).length + 1);
  return [which ? `${words} ${which}` : words, keys];
};
const STEPS: Record<string, number> = { emitter: 0.01, pivot: 0.05 };
const ARROWS: Record<string, [number, number]> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const TABS = {
  design: { label: "Design", load: () => Promise.resolve() },
  resin: { label: "Resin", load: () => import("./tabs/resin") },
  print: { label: "Print", load: () => import("./tabs/print") },
  microscope: { label: "Microscope", load: () => import("./tabs/microscope") },
  bench: { label: "Bench", load: () => import("./tabs/bench") },
};
type TabName = keyof typeof TABS;
const LATE_MS = 400;
const FEW = 5000; // rays of a response while something is dragged

interface Motion {
  name: string;
  at_deg: number;
  range_deg: [number, number];
}

interface Matter {
  key: string;
  tolerance: number;
  largest: number;
  u_largest: number;
  at_deg: number;
}

class Studio extends LitElement implements Host {
  private tab: TabName = "design";
  private opened = new Map<TabName, Tab>();
  private jobs = new Map<number, Command>();
  private link!: Link;
  private drawing!: Drawing;
  private plot!: ResponsePlot;
  private schema: Schema | null = null;
  file = "";
  private unit = "deg";
  private view: View = { angle_deg: 0, rays: 200, split: false, light: "design", lens: "own", tolerances: false };
  private colouring: Colouring = "receiver";
  private picture: Picture | null = null;
  private second!: Drawing;
  private beside: (Picture & { name: string }) | null = null;
  private values: Values = {};
  private changed = new Set<string>();
  private whole: Record<string, unknown> = {};
  private angles: [number, number] = [-3, 3];
  private curves: Partial<Record<Name, Curve>> = {};
  private note = "";
  private refused = "";
  private misleading = "";
  private noCurve = "";
  private powers: Powers | null = null;
  private matters: Matter[] = [];
  private band: Band | undefined;
  private connected = false;
  private late = false;
  private find = "";
  private guide = false;
  private commands = false;
  private searching = false;
  private sought: Sought | null = null;
  private search: Search | null = null;
  private chosen = 0;
  private gesture = "";
  private pending: Request | null = null;
  private turned = 0; // the request by which the angle was set here; older answers do not set it back

  // Light DOM: one style sheet for all, and labels that reach their controls.
  protected createRenderRoot(): HTMLElement {
    return this;
  }

  protected firstUpdated(): void {
    const canvas = this.querySelector("canvas")!;
    this.drawing = new Drawing(canvas);
    this.second = new Drawing(this.querySelector("canvas.beside")!);
    this.plot = new ResponsePlot(this.querySelector(".plot")!, (angle) => this.turnTo(angle), this.unit);
    this.plot.theme();
    this.hands(canvas);
    new ResizeObserver(() => this.resized()).observe(canvas);
    new ResizeObserver(() => this.plot.resize()).observe(this.querySelector(".plot")!);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.themed());
    addEventListener("keydown", (event) => this.shortcut(event));
    addEventListener("beforeunload", (event) => {
      if (!this.whole.is_saved && this.changed.size) event.preventDefault();
    });
    setInterval(() => {
      const late = this.link.longest > LATE_MS || !this.picture;
      if (late !== this.late) {
        this.late = late;
        this.requestUpdate();
      }
    }, 200);
    this.link = new Link(
      (frame) => this.take(frame),
      (connected) => {
        this.connected = connected;
        this.requestUpdate();
      },
    );
  }

  private take({ head, arrays }: Frame): void {
    if (head.kind === "hello") {
      this.schema = head.schema;
      this.file = head.file;
      this.unit = head.unit;
      this.guide = head.is_new;
      document.title = `${head.file} – solen studio`;
    } else if (head.kind === "drawn") {
      this.refused = "";
      const { faces, ends, handles } = head as unknown as Picture;
      this.picture = { faces, ends, handles, outline: arrays.outline, emitter: arrays.emitter, rays: arrays.rays };
      this.angles = head.angles_deg;
      this.beside = head.beside
        ? { ...head.beside, outline: arrays.beside_outline, emitter: arrays.beside_emitter, rays: arrays.beside_rays } : null;
      if (head.id >= this.turned) this.view = { ...this.view, angle_deg: head.angle_deg };
      if (head.values) {
        this.values = head.values;
        this.changed = new Set(head.changed);
        this.whole = head;
        this.dataset.version = head.version;
      }
      const curve = curveOf({ head, arrays });
      if (curve || head.no_curve !== undefined) {
        this.curves = { own: curve ?? undefined, pinned: this.whole.is_beside ? this.curves.pinned : undefined };
        this.noCurve = head.no_curve ?? "";
        this.misleading = "";
        this.matters = [];
        this.band = undefined;
        this.plot.show(this.curves, head.angle_deg);
      } else this.plot.move(head.angle_deg);
      this.redraw();
    } else if (head.kind === "curve") {
      const curve = curveOf({ head, arrays })!;
      const name = curve.head.name;
      this.curves = { ...this.curves, [name === "plane" || name === "space" ? "other" : (name as Name)]: curve };
      this.noCurve = "";
      this.plot.show(this.curves, this.view.angle_deg, this.band);
    } else if (head.kind === "matters") {
      this.matters = head.rows;
      this.band = { angle: arrays.angle.data, size: arrays.band.data };
      this.plot.show(this.curves, this.view.angle_deg, this.band);
    } else if (head.kind === "powers") {
      this.powers = head as unknown as Powers;
    } else if (head.kind === "words") {
      this.misleading = head.misleading;
    } else if (head.kind === "rest") {
      this.dataset.rest = head.version;
    } else if (head.kind === "no_curve") {
      this.noCurve = head.what;
    } else if (head.kind === "refused") {
      this.refused = head.what;
      this.link.answered(head.id);
      restore(this);
    } else if (head.kind === "suggested") {
      this.sought = head.sought;
    } else if (head.kind === "job") {
      this.work(head as unknown as Command);
    } else if (head.kind === "saved") {
      this.note = `Saved in ${head.file}`;
      this.refused = "";
    }
    this.requestUpdate();
  }

  // News of work in the background: of the search, or of a tab.
  private work(job: Command): void {
    if (job.name === "explore optimise") {
      this.search = job as unknown as Search;
      if (!this.sought) this.ask({ do: "suggest" });
      this.searching = true;
    } else {
      this.jobs.set(job.number, job);
      for (const tab of this.opened.values()) tab.take(job);
    }
  }

  // Show a tab; its part of the page is loaded when it is opened first.
  private async turn(name: TabName): Promise<void> {
    this.tab = name;
    this.requestUpdate();
    if (name === "design" || this.opened.has(name)) return;
    await TABS[name].load();
    if (this.opened.has(name)) return;
    const tab = document.createElement(`solen-${name}`) as Tab;
    tab.host = this;
    tab.className = "columns";
    this.opened.set(name, tab);
    for (const job of this.jobs.values()) tab.take(job);
    this.querySelector(`#panel-${name}`)!.append(tab);
  }

  private tabKey(event: KeyboardEvent): void {
    const names = Object.keys(TABS) as TabName[];
    const place = names.indexOf(this.tab);
    const next = { ArrowLeft: place - 1, ArrowRight: place + 1, Home: 0, End: names.length - 1 }[event.key];
    if (next === undefined) return;
    event.preventDefault();
    const name = names[(next + names.length) % names.length];
    void this.turn(name);
    this.querySelector<HTMLElement>(`#tab-${name}`)!.focus();
  }

  private redraw(): void {
    if (!this.picture || this.tab !== "design") return;
    this.drawing.draw(this.picture, this.colouring);
    if (this.beside) {
      this.second.like(this.drawing);
      this.second.draw(this.beside, this.colouring);
    }
    this.placed();
  }

  private placed(): void {
    for (const [name, [x, z]] of Object.entries(this.picture?.handles ?? {})) {
      const handle = this.querySelector<HTMLElement>(`#handle-${name}`);
      if (!handle) continue;
      if (handle === document.activeElement) this.coordinates(name);
      const [px, py] = this.drawing.toPixel(x, z);
      const [width, height] = this.drawing.size;
      handle.hidden = px < 0 || py < 0 || px > width || py > height;
      handle.style.transform = `translate(${px}px, ${py}px)`; // without a new layout
    }
  }

  private resized(): void {
    if (this.tab !== "design") return;
    this.drawing.resize();
    this.second.resize();
    if (this.picture) this.drawing.fit(this.picture);
    this.redraw();
  }

  private themed(): void {
    this.drawing.theme();
    this.second.theme();
    this.plot.theme();
    this.plot.show(this.curves, this.view.angle_deg, this.band);
    this.redraw();
  }

  // Requests of one animation frame go as one.
  ask(request: Request): void {
    this.note = "";
    if (this.pending) {
      this.pending = { ...this.pending, ...request, values: { ...this.pending.values, ...request.values } };
      return;
    }
    this.pending = request;
    requestAnimationFrame(() => {
      const asked = { view: this.view, ...this.pending };
      this.pending = null;
      const number = this.link.ask(asked);
      if (this.turned === Infinity) this.turned = number;
    });
  }

  private look(view: Partial<View>): void {
    this.view = { ...this.view, ...view };
    this.ask({ view: this.view, gesture: "look" });
    this.requestUpdate();
  }

  private change(key: string, value: unknown, gesture?: string): void {
    this.ask({ values: { [key]: value }, gesture: gesture ?? `set ${key} ${performance.now()}` });
  }

  private turnTo(angle: number): void {
    this.turned = Infinity;
    const [low, high] = this.angles;
    this.look({ angle_deg: +Math.min(Math.max(angle, low), high).toFixed(3) });
  }

  private dragHandle(name: string, to: [number, number], gesture: string): void {
    this.guide = false;
    this.ask({ handle: name, to, gesture });
  }

  private grab(event: PointerEvent, name: string): void {
    const handle = event.currentTarget as HTMLElement;
    handle.setPointerCapture(event.pointerId);
    handle.focus();
    this.coordinates(name);
    this.gesture = `drag ${name} ${performance.now()}`;
    const box = this.drawing.canvas.getBoundingClientRect();
    const [px, py] = this.drawing.toPixel(...this.picture!.handles[name]);
    const [dx, dy] = [event.clientX - box.left - px, event.clientY - box.top - py];
    handle.onpointermove = (move) =>
      this.dragHandle(name, this.drawing.toPoint(move.clientX - box.left - dx, move.clientY - box.top - dy), this.gesture);
    handle.onpointerup = handle.onpointercancel = () => {
      handle.onpointermove = handle.onpointerup = handle.onpointercancel = null;
    };
  }

  private nudge(event: KeyboardEvent, name: string): void {
    const arrow = ARROWS[event.key];
    if (!arrow || !this.picture) return;
    event.preventDefault();
    const by = event.shiftKey ? 10 : 1;
    if (name === "turn") {
      const [low, high] = this.angles;
      const step = (high - low) / 60;
      this.guide = false;
      this.turnTo(this.view.angle_deg + (arrow[0] + arrow[1]) * by * step);
      return;
    }
    const step = (STEPS[kindOf(name)] ?? 0.1) * by;
    const [x, z] = this.picture.handles[name];
    this.dragHandle(name, [x + arrow[0] * step, z + arrow[1] * step], `keys ${name}`);
  }

  // Pan with one pointer, pinch with two, zoom by the wheel, measure with the shift key held.
  private hands(canvas: HTMLCanvasElement): void {
    const down = new Map<number, [number, number]>();
    const place = (event: PointerEvent | WheelEvent): [number, number] => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.drawing.zoom(Math.exp(-event.deltaY * 0.0015), ...place(event));
      this.redraw();
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      down.set(event.pointerId, place(event));
      const [x, z] = this.drawing.toPoint(...place(event));
      this.drawing.ruler = event.shiftKey ? [x, z, x, z] : null;
      this.redraw();
    });
    canvas.addEventListener("pointermove", (event) => {
      const now = place(event);
      this.coordinates("", now);
      const before = down.get(event.pointerId);
      if (!before) return;
      down.set(event.pointerId, now);
      if (this.drawing.ruler) {
        const [x, z] = this.drawing.toPoint(...now);
        this.drawing.ruler = [this.drawing.ruler[0], this.drawing.ruler[1], x, z];
      } else if (down.size === 2) {
        const other = [...down.entries()].find(([id]) => id !== event.pointerId)![1];
        const gap = (p: [number, number]) => Math.hypot(p[0] - other[0], p[1] - other[1]);
        this.drawing.zoom(gap(now) / Math.max(gap(before), 1), ...other);
      } else {
        this.drawing.x -= (now[0] - before[0]) / this.drawing.scale;
        this.drawing.z += (now[1] - before[1]) / this.drawing.scale;
      }
      this.redraw();
    });
    for (const end of ["pointerup", "pointercancel"] as const) canvas.addEventListener(end, (event) => down.delete(event.pointerId));
  }

  // Coordinates of the pointer, or of the handle that is in use.
  private coordinates(name: string, place?: [number, number]): void {
    const point = place ? this.drawing.toPoint(...place) : this.picture?.handles[name];
    if (!point) return;
    const [x, z] = point;
    const words = `${name.replace("-", " ")}  x ${x.toFixed(3)}  z ${z.toFixed(3)} mm`.trim();
    this.querySelector(".coordinates")!.textContent = words.replaceAll("-", "−");
  }

  private zoomBy(factor: number): void {
    if (factor) this.drawing.zoom(factor);
    else if (this.picture) this.drawing.fit(this.picture);
    this.redraw();
  }

  private shortcut(event: KeyboardEvent): void {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    const order = { s: "save", z: event.shiftKey ? "redo" : "undo", y: "redo" }[event.key.toLowerCase()] as Request["do"];
    if (!order) return;
    event.preventDefault();
    (document.activeElement as HTMLElement | null)?.blur?.();
    this.ask({ do: order });
  }

  private theme(): void {
    const root = document.documentElement;
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
    this.themed();
  }

  // The drawing or the response as a file; a response as SVG needs a curve.
  private download(what: "drawing" | "response", kind: "svg" | "png"): void {
    if (!this.picture || (what === "response" && !this.plot.picture())) return;
    const name = `${this.file.replace(/\.toml$/, "")}${what === "drawing" ? "" : "-response"}.${kind}`;
    const text = () => (what === "drawing" ? this.drawing.svg(this.picture!, this.colouring) : this.plot.svg());
    if (kind === "svg") give(new Blob([text()], { type: "image/svg+xml" }), name);
    else (what === "drawing" ? this.drawing.canvas : this.plot.picture()!).toBlob((blob) => blob && give(blob, name));
  }

  private legend(): TemplateResult {
    const entries: [string, string][] =
      this.colouring === "receiver" && this.powers
        ? [["hit", "a receiver"], ["lost", "lost"]]
        : this.colouring === "receiver"
        ? [["right", "right receiver"], ["left", "left receiver"], ["lost", "lost"]]
        : this.colouring === "fate"
          ? [["hit", "detected"], ["lost", "escaped"], ["taken", "absorbed"], ["cut", "followed no further"]]
          : [["accent", "stronger where darker"]];
    return html`<ul class="legend" aria-label="Colours of rays">
      ${entries.map(([colour, words]) => html`<li><span class="line ${colour}"></span>${words}</li>`)}
    </ul>`;
  }

  private choice<T extends string>(label: string, value: T, options: [T, string][], take: (value: T) => void, hint = ""): TemplateResult {
    return html`<fieldset class="choice" title=${hint}><legend>${label}</legend>${options.map(
      ([one, words]) => html`<button type="button" aria-pressed=${String(one === value)} @click=${() => take(one)}>${words}</button>`,
    )}</fieldset>`;
  }

  // The motions of a network, each by its name.
  private stated(motions: Motion[]): TemplateResult {
    return html`<div class="motions">${motions.map(({ name, at_deg, range_deg: [low, high] }, i) => html`<div class="angle">
      <label for="motion-${i}">${name}</label>
      <input id="motion-${i}" type="range" min=${low} max=${high} step=${(high - low) / 240} .value=${String(at_deg)}
        @input=${(e: Event) => this.change(`network.motion[${i}].at_deg`, +(+(e.target as HTMLInputElement).value).toFixed(3), `motion ${name}`)}>
      <output>${at_deg.toFixed(2).replace("-", "−")}°</output>
    </div>`)}</div>`;
  }

  private tolerances(): void {
    const tolerances = !this.view.tolerances;
    if (!tolerances) this.plot.show(this.curves, this.view.angle_deg, (this.band = undefined));
    this.look({ tolerances });
  }

  private ranking(): TemplateResult {
    const rows = this.matters.map(({ key, tolerance, largest, u_largest, at_deg }) => {
      const [table, name] = [key.split(".")[0], key.split(".")[1]];
      return html`<tr><th scope="row">${table} ${nameOf(name)} ± ${+tolerance.toPrecision(3)} <span class="unit">${unitOf(name)}</span></th>
        <td>${measured(largest, u_largest)}</td><td>${sign(at_deg)}</td></tr>`;
    });
    return html`<table class="merits matters">
      <thead><tr><th scope="col">Effect of each tolerance</th><th scope="col">contrast</th><th scope="col">at</th></tr></thead>
      <tbody>${rows.length ? rows : html`<tr><td colspan="3">traced at rest …</td></tr>`}</tbody>
    </table>`;
  }

  private searches(): void {
    this.searching = !this.searching;
    if (this.searching && !this.search) this.ask({ do: "suggest" });
    this.requestUpdate();
  }

  // A search in the background, and its front.
  private straighter(): TemplateResult {
    const { search, sought } = this;
    const take = (number: number) => {
      this.chosen = number;
      this.ask({ take: number });
    };
    return html`<div class="search-panel" role="region" aria-label="Search">
      ${search ? html`${progress(search)} ${search.rows.length ? front(search, this.chosen, take) : nothing}
        <div class="same">${copied("The same from the command line", search.shell)}</div>` : nothing}
      ${sought ? asked(sought, search?.state === "running", (given) => {
        this.sought = given;
        this.chosen = 0;
        this.ask({ search: given });
      }) : nothing}
    </div>`;
  }

  private same(): TemplateResult {
    const { shell, python } = this.whole.same as { shell: string; python: string };
    return html`<aside class="guide same" aria-label="The same elsewhere">
      ${copied("The same from the command line", shell)} ${copied("The same in Python", python)}
    </aside>`;
  }

  private quality(): string {
    const own = this.curves.own?.head;
    if (!own) return this.noCurve || "The response is being traced …";
    const where = own.in_space ? "in space" : "in the plane";
    if (own.rays === null) return `Integrated ${where}.`;
    const rays = `Traced ${where}, ${own.rays.toLocaleString("en")} rays an angle`;
    return own.finished ? `${rays}.` : own.rays < FEW ? `Approximate, ${where}; refined at rest.` : `${rays}, being refined …`;
  }

  private status(): string {
    if (!this.connected) return "Not connected: the studio has ended or cannot be reached. Your last save is complete.";
    if (this.refused) return this.refused;
    if (this.late) return "Working … (the first answer after an installation takes some minutes: the tracer is compiled)";
    return this.note || (this.whole.warnings as string[] | undefined)?.[0] || "Ready";
  }

  protected render(): TemplateResult {
    const { whole, view, curves } = this;
    const shown = whole.in_space ? "space" : "plane";
    const light = view.light === "design" ? shown : view.light;
    const emitters = (whole.emitters ?? []) as string[];
    const motions = (whole.motions ?? []) as Motion[];
    return html`
      <header>
        <h1><span class="brand">solen studio</span> ${this.file}${this.changed.size && !whole.is_saved ? html`<span class="dot" title="not saved"> ●</span>` : nothing}</h1>
        <div class="tabs" role="tablist" aria-label="Steps from design to sensor" @keydown=${(e: KeyboardEvent) => this.tabKey(e)}>
          ${(Object.keys(TABS) as TabName[]).map((name) => html`<button type="button" role="tab" id="tab-${name}" aria-controls="panel-${name}"
            aria-selected=${String(name === this.tab)} tabindex=${name === this.tab ? 0 : -1} @click=${() => void this.turn(name)}>${TABS[name].label}</button>`)}
        </div>
        <nav aria-label="File">
          <button type="button" ?disabled=${!whole.can_undo} @click=${() => this.ask({ do: "undo" })} title="Ctrl+Z">Undo</button>
          <button type="button" ?disabled=${!whole.can_redo} @click=${() => this.ask({ do: "redo" })} title="Ctrl+Y">Redo</button>
          <button type="button" class="main" ?disabled=${whole.is_saved as boolean} @click=${() => this.ask({ do: "save" })} title="Ctrl+S; comments in the file are kept">Save</button>
          <button type="button" aria-expanded=${String(this.commands)} @click=${() => ((this.commands = !this.commands), this.requestUpdate())} title="The same from the command line and in Python">&gt;_</button>
          <button type="button" @click=${() => this.theme()} aria-label="Light or dark">◐</button>
          <button type="button" @click=${() => ((this.guide = !this.guide), this.requestUpdate())} aria-label="Guide" aria-expanded=${String(this.guide)}>?</button>
        </nav>
      </header>
      <main>
        <div class="columns" role="tabpanel" id="panel-design" aria-labelledby="tab-design" ?hidden=${this.tab !== "design"}>
        <section class="design" aria-label="Design">
          <div class="search"><label for="find">Find a number</label>
            <input id="find" type="search" .value=${this.find} @input=${(e: Event) => ((this.find = (e.target as HTMLInputElement).value), this.requestUpdate())}></div>
          <div class="fields">${this.schema && whole.values ? fields(this.schema, this.values, (this.whole.effective ?? {}) as Values, this.changed, (k, v, g) => this.change(k, v, g), this.find) : nothing}</div>
        </section>
        <section class="sketch" aria-label="Sensor and its rays">
          <div class="tools">
            ${this.choice("Colour by", this.colouring, [["receiver", "receiver"], ["fate", "fate"], ["power", "power"]], (value) => {
              this.colouring = value;
              this.look({ split: value === "power" });
              this.redraw();
            })}
            ${whole.has_lens ? this.choice<View["lens"]>("Entry", view.lens, whole.is_measured ? [["own", "as printed"], ["designed", "designed"], ["flat", "flat face"]] : [["own", "lens"], ["flat", "flat face"]], (lens) => this.look({ lens })) : nothing}
            ${emitters.length > 1 ? html`<label class="rays">Lit <select id="lit" @change=${(e: Event) => this.look({ lit: (e.target as HTMLSelectElement).value })}>
              ${emitters.map((one) => html`<option .selected=${one === (view.lit ?? whole.lit)}>${one}</option>`)}</select></label>` : nothing}
            <label class="rays">Rays <input type="number" min="1" max="5000" .value=${String(view.rays)} @change=${(e: Event) => {
              const rays = Math.round(+(e.target as HTMLInputElement).value);
              this.look({ rays: Math.min(Math.max(rays || 200, 1), 5000) });
            }}></label>
          </div>
          <div class="stage ${this.beside ? "two" : ""}">
            <canvas role="img" aria-label="Section of the sensor with its rays in the plane, turned by ${view.angle_deg.toFixed(2)} ${this.unit}"></canvas>
            <canvas class="beside" ?hidden=${!this.beside} role="img" aria-label="The same of ${this.beside?.name ?? "no other design"}"></canvas>
            ${this.beside ? html`<p class="beside">compared with: ${this.beside.name}</p>` : nothing}
            ${Object.keys(this.picture?.handles ?? {}).map((name) => html`<button type="button" class="handle ${kindOf(name)}" id="handle-${name}"
              aria-label=${handled(name).join(": ")} title=${handled(name).join(": drag, or ")}
              @pointerdown=${(e: PointerEvent) => this.grab(e, name)} @keydown=${(e: KeyboardEvent) => this.nudge(e, name)} @focus=${() => this.coordinates(name)}></button>`)}
            ${this.commands && whole.same ? this.same() : nothing}
            ${whole.offered ? html`<aside class="guide offered" aria-label="Unsaved changes">
              <p>Unsaved changes from earlier are in ${whole.offered}.</p>
              <button type="button" class="main" @click=${() => this.ask({ do: "restore" })}>Open them</button>
              <button type="button" @click=${() => this.ask({ do: "leave" })}>Leave them there</button>
            </aside>` : nothing}
            ${this.guide ? html`<aside class="guide" aria-label="Guide">
              <p>Light from the LED below enters through the lens, which directs more of it into the right or the left arm.</p>
              <p>When the lens turns, the contrast of the two receivers changes with the angle: the curve on the right.</p>
              <p><strong>Drag the round handle below the lens</strong>, then any number on the left.</p>
              <button type="button" class="main" @click=${() => ((this.guide = false), this.requestUpdate())}>Start</button>
            </aside>` : nothing}
            <div class="zoom" role="group" aria-label="Zoom">
              <button type="button" @click=${() => this.zoomBy(1.4)} aria-label="Larger">+</button>
              <button type="button" @click=${() => this.zoomBy(1 / 1.4)} aria-label="Smaller">−</button>
              <button type="button" @click=${() => this.zoomBy(0)} aria-label="Whole sensor">⤢</button>
              <button type="button" class="small" @click=${() => this.download("drawing", "svg")} title="The drawing">SVG</button>
              <button type="button" class="small" @click=${() => this.download("drawing", "png")} title="The drawing">PNG</button>
            </div>
            ${this.legend()}
            <output class="coordinates"></output>
          </div>
          ${motions.length ? this.stated(motions) : html`<div class="angle">
            <label for="angle">${this.unit === "deg" ? "Angle" : "Driven"}</label>
            <input id="angle" type="range" min=${this.angles[0]} max=${this.angles[1]} step=${(this.angles[1] - this.angles[0]) / 600}
              .value=${String(view.angle_deg)} @input=${(e: Event) => this.turnTo(+(e.target as HTMLInputElement).value)}>
            <output>${view.angle_deg.toFixed(2).replace("-", "−")}${this.unit === "deg" ? "°" : ` ${this.unit}`}</output>
          </div>`}
        </section>
        <section class="answer" aria-label="Response">
          <div class="tools">
            ${this.choice("Light", light, [["plane", "plane"], ["space", "space"]], (value) => this.look({ light: value === shown ? "design" : value }), "Where the response is traced; rays are drawn in the plane")}
            ${emitters.length ? nothing : html`<button type="button" aria-pressed=${String(view.tolerances)} @click=${() => this.tolerances()} title="Change of the response for each parameter that deviates by its tolerance">Tolerances</button>
            <button type="button" aria-pressed=${String(!!whole.is_beside)} @click=${() => this.ask({ do: "pin" })} title="Keep the current design for comparison, or remove it">Pin</button>
            <button type="button" aria-expanded=${String(this.searching)} @click=${() => this.searches()} title="Search for designs with a straighter response">Make it straighter</button>`}
          </div>
          <div class="plot" ?hidden=${emitters.length > 0} role="img" aria-label="Contrast against the angle, with its uncertainty"></div>
          ${emitters.length ? (this.powers ? powers(this.powers) : html`<p class="quality">The powers are being traced …</p>`) : html`<ul class="legend" aria-label="Curves">
            <li><span class="line accent"></span>design, ± u</li>
            ${curves.flat ? html`<li><span class="line dashed lost"></span>no lens</li>` : nothing}
            ${curves.other ? html`<li><span class="line dashed hit"></span>${curves.other.head.in_space ? "in space" : "in the plane"}</li>` : nothing}
            ${this.band ? html`<li><span class="line tolerated"></span>all tolerances</li>` : nothing}
            ${curves.pinned ? html`<li><span class="line dashed taken"></span>pinned</li>` : nothing}
          </ul>
          <p class="quality">${this.quality()}
            <span class="kept">Curve as
              <button type="button" @click=${() => this.download("response", "svg")} aria-label="Response as SVG">SVG</button>
              <button type="button" @click=${() => this.download("response", "png")} aria-label="Response as PNG">PNG</button></span></p>`}
          ${this.misleading ? html`<p class="warning" role="alert">${this.misleading}</p>` : nothing}
          ${this.searching ? this.straighter() : nothing}
          ${view.tolerances ? this.ranking() : nothing}
          ${emitters.length ? nothing : merits(curves.own, curves.flat, this.angles, this.unit, curves.pinned)}
        </section>
        </div>
        ${(Object.keys(TABS) as TabName[]).slice(1).map((name) => html`<div role="tabpanel" id="panel-${name}" aria-labelledby="tab-${name}" ?hidden=${this.tab !== name}></div>`)}
      </main>
      <div role="status" class="status ${this.refused || !this.connected ? "refused" : ""}">${this.status()}</div>
    `;
  }

  protected updated(): void {
    this.placed();
  }
}

customElements.define("solen-studio", Studio);
