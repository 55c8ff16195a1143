"use strict";
// Everything over time: reading, residual, temperature and chosen columns; its points follow the zoom.
(() => {
  const tc = (window.thermocorr ??= {});
  const { Chart, element, values, places } = tc;
  const AFTER = "preview after", TAKEN = "preview taken", WAIT = 60;

  const line = (curve, label, role, more = {}) => ({ curve, label, role, dash: false, dots: false, joined: true, edge: false, stretches: null, ...more });

  class TimePlot {
    // place: element; wire; troubled(error)
    constructor(place, wire, troubled) {
      Object.assign(this, { place, wire, troubled });
      this.extra = new Set(); // names of curves below the temperature
      this.preview = null; // {label, before, after}
      this.pair = []; // two steps to compare: {key, text}
      this.ghost = null; // key of the step before, whose residual stays as a ghost
      this.less = ""; // what the names of curves of the reading end with
      this.range = null; // what is shown; null for the whole record
      this.asked = 0;
    }
    show(state) {
      const before = this.fitted;
      this.fitted = state.fitted;
      this.judged = state.judged;
      if (!this.fitted) { this.clear(); return; }
      const axis = this.fitted.axis;
      if (state.history.length < 2) this.ghost = null;
      else if (before && before.key !== this.fitted.key) this.ghost = before.axis.low === axis.low && before.axis.high === axis.high && before.reading === this.fitted.reading ? before.key : null;
      if (!this.fitted.levels) this.less = "";
      if (before && (before.axis.low !== axis.low || before.axis.high !== axis.high)) this.range = null;
      const names = new Set(this.fitted.curves.map((curve) => curve.name));
      for (const name of this.extra) if (!names.has(name)) this.extra.delete(name);
      this.refresh();
    }
    clear() {
      this.chart?.remove();
      this.chart = null;
      this.signature = "";
    }
    panels() { // what is drawn: panels of lines, each with the curve that it shows
      const { fitted, judged } = this, { unit, units } = fitted;
      const floor = judged?.floor ? [2 * judged.floor.value, -2 * judged.floor.value] : [];
      const averaged = this.shown ? this.shown.averaged : true, mean = (name) => (averaged ? `mean ${name}` : name);
      const lines = (label) => [line("residual", label, "residual"), ...(averaged ? [line("mean residual", "mean of stretches", "average")] : [])];
      const small = this.place.clientWidth < 560, tall = small ? 84 : 150, low = small ? 60 : 96; // a telephone
      const residual = lines("residual"), less = this.less;
      if (this.ghost && !this.preview) residual.unshift(line("residual", "before", "ghost", { key: this.ghost }));
      const panels = small && this.preview ? [] : [{ label: fitted.reading, unit, units, height: tall, lines: [line(`reading${less}`, "measured", "reading"), line(`model${less}`, "modelled", "model"), line(`corrected${less}`, "corrected", "corrected")] }];
      if (this.pair.length === 2) {
        this.pair.forEach((step, i) => panels.push({ label: "residual", unit, units, height: tall, rules: floor, like: i ? panels.length - 1 : null, key: step.key, lines: lines(step.text) }));
      } else panels.push({ label: "residual", unit, units, height: tall, rules: floor, lines: residual });
      if (this.preview) panels.push({ label: averaged ? "mean of stretches" : "residual", unit, units, height: tall, lines: [line(mean("residual"), "now", "average"), line(mean(AFTER), `with ${this.preview.label}`, "other"), line(mean(TAKEN), "what it takes away", "model", { dash: true })] });
      const known = new Map(fitted.curves.map((curve) => [curve.name, curve]));
      if (!small) panels.push({ label: fitted.temperature, unit: known.get("temperature").unit, height: low, dense: true, lines: [line("temperature", fitted.temperature, "temperature")] });
      for (const name of this.extra) {
        const curve = known.get(name);
        if (curve) panels.push({ label: curve.label, unit: curve.unit, units: curve.units, height: low, dense: true, lines: [line(name, curve.label, "other")] });
      }
      return panels.map((panel) => ({ log: false, like: null, rules: [], key: fitted.key, ...panel }));
    }
    wanted() { // from where to where, with a margin, and how many pixels
      const { low, high } = this.fitted.axis, [from, to] = this.range || [low, high], margin = 0.5 * (to - from);
      return { low: Math.max(low, from - margin), high: Math.min(high, to + margin), n: Math.round(2 * Math.max(this.place.clientWidth, 300)) };
    }
    async fetched(panels) { // points of all panels, from one request for each step that is shown
      const { scale, zero } = this.fitted.axis, wanted = this.wanted(), found = new Map();
      const asked = panels.flatMap((panel) => panel.lines.map((l) => ({ key: l.key ?? panel.key, curve: l.curve })));
      for (const key of new Set(asked.map((one) => one.key))) {
        const names = new Set(asked.filter((one) => one.key === key).map((one) => one.curve));
        try {
          found.set(key, await this.wire.piece({ key, curves: JSON.stringify([...names]), scale, zero, ...wanted }));
        } catch (error) {
          if (key !== this.ghost) throw error;
          this.ghost = null; // its curves are no longer kept
        }
      }
      return found;
    }
    async refresh() {
      const number = ++this.asked;
      let panels = this.panels();
      let found;
      try { found = await this.fetched(panels); } catch (error) {
        if (number === this.asked) this.troubled(error);
        return;
      }
      if (number !== this.asked) return; // something newer is under way
      panels = panels.map((panel) => ({ ...panel, lines: panel.lines.filter((l) => found.has(l.key ?? panel.key)) }));
      const main = found.get(this.fitted.key), x = places(main.x);
      const columns = panels.map((panel) => panel.lines.map((l) => this.beside(x, found.get(l.key ?? panel.key), l.curve, main)));
      const shades = this.judged ? this.judged.shades : [], out = this.fitted.left_out;
      const signature = JSON.stringify([panels, this.fitted.axis, shades, out]);
      if (signature !== this.signature) this.build(panels, x, columns, shades, signature);
      else this.chart.load(x, columns);
      const averaged = this.shown?.averaged;
      this.shown = { rows: main.rows, per_point: main.per_point, averaged: Boolean(main.averaged) };
      if (averaged != null && averaged !== this.shown.averaged) this.refresh(); // too few rows for means, or enough again
      this.place.dataset.key = this.fitted.key;
      this.place.dataset.drawn = String(number);
    }
    beside(x, found, curve, main) { // a curve of another step may have other rows: its points at those of this one
      const drawn = values(found.curves[curve]);
      if (found === main) return drawn;
      const own = places(found.x), out = new Array(x.length).fill(null);
      for (let i = 0, j = 0; i < x.length; i++) {
        while (j + 1 < own.length && own[j + 1] <= x[i]) j++;
        if (drawn.length) out[i] = drawn[j];
      }
      return out;
    }
    build(panels, x, columns, shades, signature) {
      const axis = this.fitted.axis, range = this.range, brushing = this.chart?.brushing;
      this.chart?.remove();
      this.place.replaceChildren();
      const packed = (column) => ({ ready: column });
      this.chart = new Chart({
        name: "series",
        ends: [axis.low, axis.high],
        x: { label: axis.label, unit: axis.unit, joints: axis.joints, dates: axis.dates, log: false, data: { ready: x } },
        panels: panels.map((panel, i) => ({ ...panel, lines: panel.lines.map((l, k) => ({ ...l, data: packed(columns[i][k]) })) })),
        shades,
        out: this.fitted.left_out,
      }, this.place, {
        zoomed: (low, high) => this.zoomed(low, high),
        brushed: (low, high) => { this.selected = [low, high]; },
      });
      this.signature = signature;
      if (brushing) this.chart.brush(true);
      if (range) this.chart.zoom(...range);
      else this.chart.zoom();
    }
    zoomed(low, high) {
      const { axis } = this.fitted, whole = low <= axis.low && high >= axis.high;
      this.range = whole ? null : [low, high];
      clearTimeout(this.waiting);
      this.waiting = setTimeout(() => this.refresh(), WAIT);
    }
    go(low, high) { // show a stretch, with some of what is around it
      const margin = 0.25 * (high - low);
      this.chart?.zoom(low - margin, high + margin);
    }
    brush(on) {
      this.chart?.brush(on);
      if (!on) this.selected = null;
    }
    stretch() { // what was selected, or else what is shown
      const { axis } = this.fitted;
      return this.selected || this.range || [axis.low, axis.high];
    }
    toggle(name, on) {
      if (on) this.extra.add(name); else this.extra.delete(name);
      this.refresh();
    }
    previewed(preview) {
      this.preview = preview;
      if (this.fitted) this.refresh();
    }
    levelled(on) {
      this.less = on ? " less level" : "";
      if (this.fitted) this.refresh();
    }
    compared(pair) { // two steps, or none
      this.pair = pair;
      if (this.fitted) this.refresh();
    }
  }

  tc.TimePlot = TimePlot;
})();
