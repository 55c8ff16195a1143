"use strict";
// The workbench: the state as it comes, the lists and plots that show it, and what the user does.
(() => {
  const tc = (window.thermocorr ??= {});
  const { element, Part, TimePlot, Views, panels, number } = tc;
  const HOVER = 120; // a pointer that stays so long means it [ms]

  class Workbench {
    constructor(root, makeWire) {
      this.root = root;
      this.state = null;
      this.busy = 0;
      this.chosen = []; // keys of steps that are compared
      this.promised = null; // the error that the suspect under the pointer would leave
      const at = (name) => root.querySelector(`[data-part="${name}"]`);
      this.at = at;
      this.wire = makeWire((kind, content) => this.hear(kind, content));
      this.plot = new TimePlot(at("plot"), this.wire, (error) => this.failed(error));
      this.views = new Views(at("views"), this.wire, (error) => this.failed(error));
      const act = {
        do: (asked, complain) => this.do(asked, complain), go: (place) => this.go(place),
        preview: (...given) => this.preview(...given), compare: (row) => this.compare(row),
        curve: (name, on) => this.plot.toggle(name, on),
      };
      const part = (name, build) => new Part(at(name), build);
      this.parts = [
        [part("columns", (s) => panels.columns(s, act)), (s) => ({ columns: s.columns, decided: s.decided, source: s.source, times: s.fitted?.without_times })],
        [part("model", (s) => panels.model(s, act)), (s) => ({ model: s.model, fitted: s.fitted && { time_constants: s.fitted.time_constants, equation: s.fitted.equation } })],
        [part("history", (s) => panels.history(s, act, this.chosen)), (s) => ({ history: s.history, judged: s.judged && { floor: s.judged.floor }, can_undo: s.can_undo, can_redo: s.can_redo, chosen: this.chosen })],
        [part("summary", (s) => panels.summary(s, this.promised)), (s) => ({ history: s.history, judged: s.judged && { floor: s.judged.floor }, fitted: Boolean(s.fitted), advised: s.advised, promised: this.promised })],
        [part("raw", (s) => panels.raw(s)), (s) => ({ raw: s.raw, fitted: Boolean(s.fitted) })],
        [part("verdict", (s) => panels.verdict(s, act)), (s) => ({ judged: s.judged, lacking: s.lacking, fitted: s.fitted && { notes: s.fitted.notes } })],
        [part("where", (s) => panels.where(s, act)), (s) => ({ judged: s.judged })],
        [part("suspects", (s) => panels.suspects(s, act)), (s) => ({ judged: s.judged, key: s.fitted?.key })],
        [part("beside", (s) => panels.beside(s, act, this.plot.extra)), (s) => ({ fitted: s.fitted && { curves: s.fitted.curves } })],
      ];
      this.tools();
      this.keys();
    }
    tools() {
      const step = (low, high) => () => this.plot.chart?.step(low, high);
      this.mode = element("button", { type: "button", "aria-pressed": "false", onclick: () => this.select(this.mode.getAttribute("aria-pressed") !== "true") }, "Select a stretch");
      const zoom = { "Whole record": () => this.plot.chart?.zoom(), "+": step(0.25, 0.75), "−": step(-0.5, 1.5), "◀": step(-0.5, 0.5), "▶": step(0.5, 1.5) };
      const names = { "+": "zoom in", "−": "zoom out", "◀": "earlier", "▶": "later" };
      this.level = element("button", { type: "button", "aria-pressed": "false", hidden: true, "data-at": "level", onclick: () => { const on = this.level.getAttribute("aria-pressed") !== "true"; this.level.setAttribute("aria-pressed", String(on)); this.plot.levelled(on); } }, "Runs less their level");
      this.at("zoom").replaceChildren(...Object.entries(zoom).map(([name, run]) => element("button", { type: "button", "aria-label": names[name] || name, onclick: run }, name)), this.mode, this.level);
      this.marks = element("div", { class: "marks", hidden: true });
      this.at("marks").replaceChildren(this.marks);
      this.at("cancel")?.addEventListener("click", () => this.wire.cancel());
      this.at("dismiss").addEventListener("click", () => this.trouble(""));
      const menu = this.at("take").closest("details");
      this.root.addEventListener("click", (event) => { if (menu && !event.target.closest("summary")) menu.open = false; });
      const samples = this.at("samples");
      samples?.addEventListener("change", () => { if (samples.value) this.open({ sample: samples.value }); samples.value = ""; });
      const file = this.at("open");
      file?.addEventListener("change", () => { if (file.files.length) this.open(file.files[0]); file.value = ""; });
      if (!file) return;
      this.root.addEventListener("dragover", (event) => event.preventDefault());
      this.root.addEventListener("drop", (event) => { event.preventDefault(); if (event.dataTransfer.files.length) this.open(event.dataTransfer.files[0]); });
    }
    keys() {
      const place = this.root.parentElement === document.body ? document : this.root;
      place.addEventListener("keydown", (event) => {
        if (event.target.matches?.("input[type=text], input[type=number], textarea")) return;
        if ((event.ctrlKey || event.metaKey) && event.key === "z") { event.preventDefault(); if (this.state?.can_undo) this.do({ do: "undo" }); }
        else if ((event.ctrlKey || event.metaKey) && event.key === "y") { event.preventDefault(); if (this.state?.can_redo) this.do({ do: "redo" }); }
        else if (event.key === "Escape") { this.select(false); this.preview(null); }
      });
    }
    hear(kind, content) {
      if (kind === "state") this.show(content);
      else if (kind === "progress") this.progress(content.text);
      else if (kind === "ended") { this.progress(""); this.trouble("The workbench has ended. Start it again to go on."); this.root.dataset.ended = "1"; }
    }
    show(state) {
      this.state = state;
      this.root.dataset.revision = state.revision;
      if (!state.columns) { if (state.trouble) this.trouble(state.trouble); return; }
      if (!this.at("take").children.length) this.menus(state);
      this.at("source").textContent = `${state.source.name}, ${state.source.rows.toLocaleString("en")} rows`;
      const problem = state.trouble || state.problem;
      if (problem || this.problem) this.trouble(problem);
      this.problem = problem;
      const there = new Set(state.history.map((row) => row.key));
      if (this.chosen.some((key) => !there.has(key))) this.chosen = this.plot.pair = [];
      if (state.fitted?.key !== this.plot.fitted?.key) this.plot.preview = this.promised = null;
      for (const [part, content] of this.parts) part.show({ ...content(state) }, state);
      if (state.fitted) delete this.root.dataset.empty; else this.root.dataset.empty = "1";
      this.level.hidden = !state.fitted?.levels;
      this.plot.show(state);
      this.views.show(state);
      this.root.dataset.judged = state.judged && state.fitted ? state.fitted.key : "";
    }
    menus(state) { // what can be done with any log, in the program's words
      const each = (named, make) => Object.entries(named).map(([name, text]) => make(name, text));
      const button = (what, run) => (name, text) => element("button", { type: "button", [what]: name, onclick: () => run(name) }, text);
      if (this.at("samples")?.options.length < 2) this.at("samples").append(...each(state.samples, (name, text) => element("option", { value: name }, text)));
      this.at("take").append(...each(state.take, button("data-take", (kind) => this.take(kind))));
      this.marks.append(element("span", { class: "fine" }, "this stretch: "), element("button", { type: "button", "data-leave-out": "", onclick: () => this.leaveOut() }, "Leave out"));
    }
    progress(text) {
      this.at("progress").textContent = text ? `${text}…` : "";
      if (this.at("cancel")) this.at("cancel").hidden = !text;
      this.root.dataset.progress = text;
    }
    again() { // what was chosen and refused is not in force: show what is
      for (const [part] of this.parts.slice(0, 2)) part.shown = null;
      if (this.state) this.show(this.state);
    }
    failed(error) { // of what is drawn
      if (!(error instanceof tc.Gone)) this.trouble(error.message);
    }
    trouble(text) {
      this.at("trouble").textContent = text || "";
      this.at("alert").hidden = !text;
    }
    async do(asked, complain = (text) => this.trouble(text)) {
      if (this.busy) return null;
      clearTimeout(this.hover);
      this.hovered = null;
      this.busy += 1;
      this.root.dataset.busy = "1";
      this.trouble("");
      try {
        return await this.wire.ask(asked, this.state?.revision);
      } catch (error) {
        complain(error.message);
        if (asked.do === "shape") this.again();
        return null;
      } finally {
        this.busy -= 1;
        delete this.root.dataset.busy;
      }
    }
    preview(place, alike, shown) {
      clearTimeout(this.hover);
      const wanted = place == null ? null : `${place} ${alike}`;
      if (wanted === this.hovered) return;
      this.hover = setTimeout(async () => {
        this.hovered = wanted;
        if (wanted == null) { if (this.plot.preview) this.plot.previewed(null); this.promise(null); return; }
        const key = this.state.fitted?.key;
        if (!this.state.judged || place >= this.state.judged.suspects.length) return;
        let found;
        try { found = await this.wire.ask({ do: "preview", suspect: place, alike: alike ?? null }); } catch { return; }
        if (this.hovered !== wanted || this.state.fitted?.key !== key) return;
        shown.textContent = "";
        shown.append("In sample it would leave ", number(found.after), " instead of ", number(found.before), ".");
        this.plot.previewed(found);
        this.promise(alike == null ? this.state.judged.suspects[place].after : null);
      }, place == null ? 2 * HOVER : HOVER);
    }
    promise(error) {
      this.promised = error;
      this.show(this.state);
    }
    go(place) {
      if (place.from_to) this.plot.go(...place.from_to);
      else if (place.curve) {
        this.views.against(place.curve, place.range);
        this.at("views").scrollIntoView({ block: "nearest", behavior: "smooth" });
      }
    }
    select(on) {
      if (on && !this.plot.chart) { this.trouble("There is nothing to select in yet."); return; }
      this.mode.setAttribute("aria-pressed", String(on));
      this.marks.hidden = !on;
      this.plot.brush(on);
    }
    leaveOut() {
      const [low, high] = this.plot.stretch();
      this.select(false);
      return this.do({ do: "leave_out", low, high });
    }
    async compare(row) { // choose two steps, one after the other; a chosen one is let go
      const without = this.chosen.filter((key) => key !== row.key), now = this.state.history;
      const chosen = without.length < this.chosen.length ? without : [...without.slice(-1), row.key];
      const rows = now.filter((one) => chosen.includes(one.key));
      if (rows.length === 2) for (const one of rows) if (!(await this.do({ do: "fit", step: one.step }))) return;
      this.chosen = chosen;
      this.plot.compared(rows.length === 2 ? rows.map((one) => ({ key: one.key, text: `after step ${one.step}` })) : []);
      this.show(this.state);
    }
    async take(kind) {
      this.trouble("");
      try { await this.wire.take(kind); } catch (error) { this.trouble(error.message); }
    }
    async open(file) {
      this.trouble("");
      try { await (file.sample ? this.wire.sample(file.sample) : this.wire.open(file)); } catch (error) { this.trouble(error.message); }
    }
  }

  tc.Workbench = Workbench;
})();
