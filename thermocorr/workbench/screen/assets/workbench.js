"use strict";
// The workbench: the state as it comes, the lists and pictures that show it, and what the user does.
(() => {
  const tc = (window.thermocorr ??= {});
  const { element, Part, Picture, TimePicture, Tabs, panels, number } = tc;
  const HOVER = 120; // a pointer that stays so long means it [ms]

  class Workbench {
    constructor(root, makeWire) {
      Object.assign(this, { root, state: null, busy: 0, promised: null, doing: "" });
      const at = (name) => root.querySelector(`[data-part="${name}"]`);
      this.at = at;
      this.wire = makeWire((kind, content) => this.hear(kind, content));
      const troubled = (error) => this.trouble(error.message);
      this.bars = new Picture(at("bars"), this.wire, troubled);
      this.plot = new TimePicture(at("plot"), this.wire, troubled);
      this.views = new Tabs(at("views"), this.wire, troubled);
      const act = {
        do: (asked, complain) => this.do(asked, complain), go: (place) => this.go(place), add: (place, alike) => this.add(place, alike),
        preview: (...given) => this.preview(...given), compare: (step) => this.compare(step),
        half: (role, name) => { for (const column of this.state.columns) if (column.name === name) column.role = role; this.show(this.state); },
        below: (name, on) => this.plot.set({ columns: on ? [...this.plot.how.columns, name] : this.plot.how.columns.filter((one) => one !== name) }),
      };
      const part = (name, build) => new Part(at(name), build);
      this.parts = [
        [part("columns", (s) => panels.columns(s, act)), (s) => ({ columns: s.columns, decided: s.decided, source: s.source, times: s.fitted?.without_times })],
        [part("model", (s) => panels.model(s, act)), (s) => ({ model: s.model, fitted: s.fitted && { time_constants: s.fitted.time_constants, equation: s.fitted.equation } })],
        [part("history", (s) => panels.history(s, act, this.plot.how.versus)), (s) => ({ history: s.history, can_undo: s.can_undo, can_redo: s.can_redo, versus: this.plot.how.versus, out: s.fitted?.left_out })],
        [part("summary", (s) => panels.summary(s, this.promised)), (s) => ({ errors: s.errors, fitted: Boolean(s.fitted), advised: s.advised, promised: this.promised })],
        [part("raw", (s) => panels.raw(s)), (s) => ({ raw: s.raw, fitted: Boolean(s.fitted) })],
        [part("verdict", (s) => panels.verdict(s, act, this.doing)), (s) => ({ judged: s.judged, lacking: s.lacking, fitted: s.fitted && { notes: s.fitted.notes }, doing: s.judged ? "" : this.doing })],
        [part("suspects", (s) => panels.suspects(s, act)), (s) => ({ judged: s.judged, key: s.fitted?.key })],
        [part("where", (s) => panels.where(s, act)), (s) => ({ where: s.fitted?.where, judged: Boolean(s.judged) })],
        [part("below", (s) => panels.below(s, act, this.plot.how.columns)), (s) => ({ below: s.fitted?.below })],
      ];
      this.tools();
      this.keys();
      new ResizeObserver(() => { clearTimeout(this.resized); this.resized = setTimeout(() => this.fit(), 150); }).observe(root);
    }
    fit() { // pictures take the width of their places
      if (!this.state?.fitted || this.width === this.at("plot").clientWidth) return;
      this.width = this.at("plot").clientWidth;
      this.drawBars();
      this.plot.refresh();
      this.views.refresh();
    }
    tools() {
      const step = (low, high) => () => this.plot.found && this.plot.step(low, high);
      this.mode = element("button", { type: "button", "aria-pressed": "false", onclick: () => this.select(this.mode.getAttribute("aria-pressed") !== "true") }, "Select a stretch");
      const zoom = { "Whole record": () => this.plot.found && this.plot.zoom(null), "+": step(0.25, 0.75), "−": step(-0.5, 1.5), "◀": step(-0.5, 0.5), "▶": step(0.5, 1.5) };
      const names = { "+": "zoom in", "−": "zoom out", "◀": "earlier", "▶": "later" };
      this.level = element("button", { type: "button", "aria-pressed": "false", hidden: true, "data-at": "level", onclick: () => { const on = this.level.getAttribute("aria-pressed") !== "true"; this.level.setAttribute("aria-pressed", String(on)); this.plot.set({ levels: !on }); } }, "Subtract run levels");
      this.marks = element("button", { type: "button", hidden: true, "data-leave-out": "", onclick: () => this.leaveOut() }, "Leave it out");
      this.at("zoom").replaceChildren(...Object.entries(zoom).map(([name, run]) => element("button", { type: "button", "aria-label": names[name] || name, onclick: run }, name)), this.mode, this.marks, this.level);
      this.at("cancel")?.addEventListener("click", () => this.wire.cancel());
      this.at("dismiss").addEventListener("click", () => this.trouble(""));
      this.menu = this.at("take").closest("details");
      this.root.addEventListener("click", (event) => { if (!event.target.closest("summary")) this.menu.open = false; });
      const file = this.at("open");
      file?.addEventListener("change", () => { if (file.files.length) this.open(file.files[0]); file.value = ""; });
      this.at("remedy").addEventListener("click", () => this.mend());
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
        else if (event.key === "Escape") {
          if (this.menu.open) { this.menu.open = false; this.menu.querySelector("summary").focus(); }
          this.select(false);
          this.preview(null);
        }
      });
    }
    hear(kind, content) {
      if (kind === "state") this.show(content);
      else if (kind === "progress") this.progress(content.text);
      else if (kind === "ended") { this.progress(""); this.trouble("The workbench has ended. Start it again to go on."); this.root.dataset.ended = "1"; }
    }
    show(state) {
      const before = this.state;
      this.state = state;
      this.root.dataset.revision = state.revision;
      if (!state.columns) { if (state.trouble) this.trouble(state.trouble, state.remedy); return; }
      if (!this.at("take").children.length) this.menus(state);
      this.at("source").textContent = `${state.source.name}, ${state.source.rows.toLocaleString("en")} rows`;
      const problem = state.trouble || (state.decided ? state.problem : "");
      if (problem || this.problem) this.trouble(problem, state.remedy);
      this.problem = problem;
      const moved = state.fitted?.key !== before?.fitted?.key;
      if (moved) this.promised = null;
      if (state.fitted) delete this.root.dataset.empty; else this.root.dataset.empty = "1";
      this.level.hidden = !state.fitted?.levels;
      const drawn = (of) => of?.fitted && JSON.stringify([of.fitted.key, Boolean(of.judged), of.revision]);
      if (drawn(state) !== drawn(before)) { this.width = this.at("plot").clientWidth; this.plot.show(state.fitted); }
      this.views.show(state.fitted, state.judged);
      if (JSON.stringify(state.errors) !== JSON.stringify(before?.errors) || moved || state.judged?.floor?.value !== before?.judged?.floor?.value) this.drawBars();
      this.update();
      this.root.dataset.judged = state.judged && state.fitted ? state.fitted.key : "";
    }
    update() { for (const [part, content] of this.parts) part.show(content(this.state), this.state); }
    async drawBars() {
      if (!this.state?.fitted) { this.bars.clear(); return; }
      const found = await this.bars.draw({ name: "errors", promised: this.promised?.value ?? null });
      if (found) this.at("bars").dataset.drawn = JSON.stringify(this.state.errors.map((row) => row.error?.value ?? null));
    }
    menus(state) { // what can be done with any log, in the program's words
      this.at("take").append(...Object.entries(state.take).map(([name, text]) => element("button", { type: "button", "data-take": name, onclick: () => this.take(name) }, text)));
    }
    progress(text) {
      this.doing = text;
      this.at("progress").textContent = text ? `${text}…` : "";
      if (this.at("cancel")) this.at("cancel").hidden = !text;
      this.root.dataset.progress = text;
      if (this.state?.fitted && !this.state.judged) this.update();
    }
    again() { // what was chosen and refused is not in force: show what is
      for (const [part] of this.parts.slice(0, 2)) part.shown = null;
      if (this.state) this.update();
    }
    trouble(text, remedy = "") {
      this.at("trouble").textContent = text || "";
      this.at("alert").hidden = !text;
      this.at("remedy").hidden = !remedy;
      this.at("remedy").textContent = remedy || "";
    }
    async do(asked, complain = (text) => this.trouble(text)) {
      if (this.busy) return null;
      clearTimeout(this.hover);
      this.hovered = null;
      this.busy += 1;
      this.root.dataset.busy = "1";
      this.trouble("");
      try {
        return await this.wire.asked("do", { ...asked, revision: this.state?.revision });
      } catch (error) {
        complain(error.message);
        if (asked.do === "shape") this.again();
        return null;
      } finally {
        this.busy -= 1;
        delete this.root.dataset.busy;
      }
    }
    async add(place, alike) { // the list that it was chosen from goes: the verdict comes next
      const done = await this.do({ do: "add", place, alike: alike ?? null });
      if (done) this.root.querySelector('[data-at="verdict"]')?.focus({ preventScroll: true });
    }
    preview(place, alike, shown) {
      clearTimeout(this.hover);
      const wanted = place == null ? null : `${place} ${alike}`;
      if (wanted === this.hovered) return;
      this.hover = setTimeout(async () => {
        this.hovered = wanted;
        if (wanted == null) { if (this.plot.how.preview) this.plot.set({ preview: false }); this.promise(null); return; }
        const key = this.state.fitted?.key;
        if (!this.state.judged || place >= this.state.judged.suspects.length) return;
        let found;
        try { found = await this.wire.asked("do", { do: "preview", place, alike: alike ?? null }); } catch { return; }
        if (this.hovered !== wanted || this.state.fitted?.key !== key) return;
        shown.textContent = "";
        shown.append("In sample it would leave ", number(found.after), " instead of ", number(found.before), ".");
        this.plot.set({ preview: true });
        this.promise(alike == null ? this.state.judged.suspects[place].after : null);
      }, place == null ? 2 * HOVER : HOVER);
    }
    promise(error) {
      if (error?.value === this.promised?.value) return;
      this.promised = error;
      this.drawBars();
      this.update();
    }
    go(place) {
      if (place.from_to) this.plot.go(...place.from_to);
      else if (place.column != null) {
        this.views.against(place.column, place.range);
        this.at("views").scrollIntoView({ block: "nearest", behavior: "smooth" });
      }
    }
    select(on) {
      if (on && !this.plot.found) { this.trouble("There is nothing to select in yet."); return; }
      this.mode.setAttribute("aria-pressed", String(on));
      this.marks.hidden = !on;
      this.plot.brush(on);
    }
    leaveOut() {
      const [low, high] = this.plot.stretch();
      this.select(false);
      return this.do({ do: "leave_out", low, high });
    }
    async compare(step) { // the residual after an earlier step, as a line; once more: that of the step before
      await this.plot.set({ versus: this.plot.how.versus === step ? null : step });
      this.update();
    }
    async take(kind) {
      this.trouble("");
      try {
        const { name, media, content } = await this.wire.asked("take", { kind }), raw = atob(content);
        tc.saved(name, new Blob([Uint8Array.from(raw, (sign) => sign.charCodeAt(0))], { type: media }));
      } catch (error) { this.trouble(error.message); }
    }
    async open(file) { await this.opened(this.wire.open(file)); }
    async mend() { await this.opened(this.wire.mend()); }
    async opened(answer) {
      this.trouble("");
      try { await answer; } catch (error) { this.trouble(error.message, error.remedy); }
    }
  }

  tc.Workbench = Workbench;
})();
