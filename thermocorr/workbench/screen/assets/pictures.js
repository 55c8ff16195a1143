"use strict";
// Pictures that the program draws, as they are: the record over time, which zooms, and others below it.
(() => {
  const tc = (window.thermocorr ??= {});
  const { element } = tc;
  const TABS = { against: "Residual against…", where: "Where it fails", contributions: "What each effect adds", allan: "For how long averaging helps" };
  const CAPTIONS = {
    against: "Points: some of the rows. Line: the mean of all rows in each range, with a band of twice its error, assuming white noise. A line that leaves zero shows a law that the model lacks.",
    where: "Each bar: an interval's share of the error beyond the noise, over its share of the samples.",
    contributions: "What each effect adds, the largest first; at the right, what it adds after a step of the temperature.",
    allan: "Averaging helps as long as the Allan deviation of the corrected readings falls along the dashed line of white noise. Bands: 95 % confidence.",
  };

  class Picture { // place: element; ask: what is wanted of the program
    constructor(place, wire, troubled) {
      Object.assign(this, { place, wire, troubled });
      this.number = 0;
    }
    async draw(asked) { // the newest answer counts
      const number = ++this.number;
      let found;
      try { found = await this.wire.asked("picture", { width: Math.max(this.place.clientWidth, 280), ...asked }); } catch (error) {
        if (number === this.number) this.troubled(error);
        return null;
      }
      if (number !== this.number) return null;
      const box = document.createElement("div");
      box.innerHTML = found.svg; // drawn by the program, which escapes all names
      this.place.replaceChildren(...box.children);
      return found;
    }
    clear() { this.number += 1; this.place.replaceChildren(); }
  }

  class TimePicture extends Picture {
    constructor(place, wire, troubled) {
      super(place, wire, troubled);
      this.how = { columns: [], levels: true, preview: false, versus: null };
      this.range = null; // what is shown; null for the whole record
      this.selecting = false;
      this.chosen = element("div", { class: "chosen", hidden: true });
      this.pointer = element("div", { class: "pointer", hidden: true });
      this.readout = element("p", { class: "readout fine", "aria-live": "off" });
      place.after(this.readout);
      place.addEventListener("pointerdown", (event) => this.begin(event));
      place.addEventListener("pointermove", (event) => this.move(event));
      place.addEventListener("pointerup", (event) => this.end(event));
      place.addEventListener("pointerleave", () => { this.pointer.hidden = true; this.readout.textContent = ""; });
      place.addEventListener("dblclick", () => this.zoom(null));
    }
    show(fitted) {
      const before = this.fitted;
      this.fitted = fitted;
      if (!fitted) { this.clear(); this.readout.textContent = ""; return; }
      if (before && before.span !== fitted.span) this.range = null;
      if (before && before.key !== fitted.key) this.how = { ...this.how, preview: false, versus: null };
      if (!this.how.columns.length && !before) this.how.columns = [fitted.temperature];
      this.how.columns = this.how.columns.filter((name) => name in fitted.below);
      this.refresh();
    }
    async refresh() {
      if (!this.fitted) return;
      const key = this.fitted.key, [low, high] = this.range ?? [null, null];
      const columns = this.place.clientWidth < 560 ? [] : this.how.columns; // a telephone
      const found = await this.draw({ name: "time", low, high, ...this.how, columns });
      if (!found) return;
      this.found = found;
      this.place.append(this.chosen, this.pointer);
      this.select(this.selected ?? null);
      this.place.dataset.key = key;
      this.place.dataset.drawn = String(this.number);
    }
    set(how) { this.how = { ...this.how, ...how }; return this.refresh(); }
    ends() { return this.range ?? [0, this.fitted.span]; }
    at(event) { // place on the axis of time under a pointer [s]
      const box = this.place.getBoundingClientRect(), share = (event.clientX - box.left) / box.width;
      const [low, high] = this.axis();
      return low + (share - this.found.left) / (this.found.right - this.found.left) * (high - low);
    }
    axis() { // what the picture's axis spans: the whole record has a margin of a hundredth
      const [low, high] = this.ends();
      if (this.range) return [low, high];
      const margin = 0.01 * (high - low);
      return [low - margin, high + margin];
    }
    share(place) {
      const [low, high] = this.axis();
      return 100 * (this.found.left + (place - low) / (high - low) * (this.found.right - this.found.left));
    }
    begin(event) {
      if (!this.found || event.button !== 0) return;
      this.from = this.at(event);
      if (event.pointerType === "mouse") this.place.setPointerCapture(event.pointerId);
    }
    move(event) {
      if (!this.found) return;
      const here = this.at(event);
      if (this.from != null && event.pointerType === "mouse") this.select([this.from, here]);
      this.read(here);
    }
    end(event) {
      if (!this.found || this.from == null) return;
      const both = [this.from, this.at(event)].sort((a, b) => a - b);
      this.from = null;
      const [low, high] = this.axis();
      if (both[1] - both[0] < 0.008 * (high - low)) { if (!this.selecting) this.select(null); return; }
      if (this.selecting) this.select(both);
      else this.zoom(both);
    }
    select(range) { // show a stretch as selected; null for none
      this.chosen.hidden = !range;
      if (!range) { this.selected = null; return; }
      const [a, b] = range.map((v) => this.share(v)).sort((x, y) => x - y);
      this.chosen.style.left = `${a}%`;
      this.chosen.style.width = `${b - a}%`;
      this.selected = [...range].sort((x, y) => x - y);
    }
    read(place) { // the values under the pointer
      const points = this.found.points;
      if (!points.length) return;
      let low = 0, high = points.length - 1;
      while (low < high) { const middle = (low + high) >> 1; if (points[middle][0] < place) low = middle + 1; else high = middle; }
      if (low > 0 && place - points[low - 1][0] < points[low][0] - place) low -= 1;
      const [at, when, measured, model, left] = points[low];
      this.pointer.hidden = false;
      this.pointer.style.left = `${this.share(at)}%`;
      this.readout.textContent = `${when}: measured ${measured}, model ${model}, left ${left}`;
    }
    zoom(range) {
      const span = this.fitted.span;
      if (range) {
        const wide = Math.min(range[1] - range[0], span), from = Math.min(Math.max(range[0], 0), span - wide);
        range = wide >= span ? null : [from, from + wide];
      }
      this.range = range;
      return this.refresh();
    }
    step(low, high) { // shares of what is shown
      const [from, to] = this.ends();
      return this.zoom([from + low * (to - from), from + high * (to - from)]);
    }
    go(low, high) { // show a stretch, with some of what is around it
      const margin = 0.5 * (high - low);
      return this.zoom([low - margin, high + margin]);
    }
    brush(on) { this.selecting = on; if (!on && this.found) this.select(null); }
    stretch() { return this.selected ?? this.ends(); } // what was selected, or else what is shown
  }

  class Tabs extends Picture {
    constructor(place, wire, troubled) {
      super(element("div", { class: "shown", role: "tabpanel", "aria-label": "picture" }), wire, troubled);
      this.tabs = element("div", { class: "tabs", role: "tablist", "aria-label": "pictures" });
      this.tools = element("div", { class: "tools" });
      this.caption = element("p", { class: "fine" });
      place.replaceChildren(this.tabs, this.tools, this.place, this.caption);
      Object.assign(this, { tab: "against", column: null, range: null });
    }
    show(fitted, judged) {
      const news = fitted?.key !== this.fitted?.key || Boolean(judged) !== this.judged;
      Object.assign(this, { fitted, judged: Boolean(judged) });
      if (!fitted) { this.clear(); this.tabs.replaceChildren(); this.tools.replaceChildren(); this.caption.textContent = ""; return; }
      if (news) this.refresh();
    }
    choose(tab) { this.tab = tab; this.refresh(); this.tabs.querySelector(`[data-tab="${tab}"]`)?.focus(); }
    against(column, range = null) { Object.assign(this, { tab: "against", column, range }); return this.refresh(); }
    async refresh() {
      const { against } = this.fitted, names = Object.keys(TABS).filter((name) => name !== "where" || this.judged);
      if (!names.includes(this.tab)) this.tab = "against";
      if (!(this.column in against)) Object.assign(this, { column: Object.keys(against)[0], range: null });
      this.tabs.replaceChildren(...names.map((name, i) => element("button", {
        type: "button", role: "tab", "data-tab": name, "aria-selected": String(name === this.tab), tabindex: name === this.tab ? 0 : -1,
        onclick: () => this.choose(name),
        onkeydown: (event) => { const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key]; if (step) this.choose(names[(i + step + names.length) % names.length]); },
      }, TABS[name])));
      const select = element("select", { "aria-label": "condition", "data-at": "against", onchange: (event) => this.against(event.target.value) }, Object.entries(against).map(([name, text]) => element("option", { value: name }, text)));
      select.value = this.column;
      this.tools.replaceChildren(...(this.tab === "against" ? [select] : []));
      this.caption.textContent = CAPTIONS[this.tab];
      const [low, high] = this.range ?? [null, null];
      const found = await this.draw(this.tab === "against" ? { name: this.tab, column: this.column, low, high } : { name: this.tab });
      if (found) this.place.dataset.shown = `${this.tab} ${this.fitted.key}`;
    }
  }

  Object.assign(tc, { Picture, TimePicture, Tabs });
})();
