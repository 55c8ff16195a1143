"use strict";
(() => {
  const charts = {}; // by their names, for those that show the same numbers
  const SUPER = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
  const raised = (n) => String(n).replace(/[-0-9]/g, (c) => SUPER[c]);
  const minus = (text) => text.replace("-", "−");

  // ---- numbers out of base64
  function bytes(text) {
    const raw = atob(text), out = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
    return out.buffer;
  }
  function floats(data, single) { // little-endian whatever the machine
    const view = new DataView(bytes(data)), size = single ? 4 : 8, out = new Float64Array(view.byteLength / size);
    for (let i = 0; i < out.length; i++) out[i] = single ? view.getFloat32(4 * i, true) : view.getFloat64(8 * i, true);
    return out;
  }
  function values(packed) {
    if (packed.ready) return packed.ready;
    if (packed.same) return charts[packed.same[0]].columns[packed.same[1]][packed.same[2]];
    const raw = floats(packed.f4, true), out = new Array(raw.length);
    for (let i = 0; i < raw.length; i++) out[i] = raw[i] === raw[i] ? raw[i] + packed.add : null;
    return out;
  }
  function held(points, means, n) { // means that belong to stretches of points, from the first to the last of each
    const out = new Array(n).fill(null);
    for (let i = 0; i < means.length; i++) out.fill(means[i], points[2 * i], points[2 * i + 1] + 1);
    return out;
  }
  function places(packed) {
    if (packed.ready) return packed.ready;
    if (packed.same) return charts[packed.same].x;
    if (packed.f8) return floats(packed.f8, false);
    return Float64Array.from({ length: packed.n }, (_, i) => packed.start + i * packed.step);
  }

  // ---- numbers as a person writes them
  function decimals(step) {
    for (let d = 0; d < 13; d++) if (Math.abs(step * 10 ** d - Math.round(step * 10 ** d)) < 1e-6 * step * 10 ** d) return d;
    return 13;
  }
  function digits(u) { // so many that neighbours of a curve can be told apart
    const { min, max } = u.scales.y, size = Math.max(Math.abs(min), Math.abs(max)), span = Math.abs(max - min);
    return span > 0 && size > 0 ? Math.min(Math.max(4 + Math.ceil(Math.log10(size / span)), 6), 13) : 6;
  }
  function figure(v, unit, precision = 6) {
    if (v == null) return "–";
    const size = Math.abs(v);
    let text = String(Number(v.toPrecision(precision)));
    if (size && (size < 1e-3 || size >= 1e7)) {
      const [mantissa, power] = v.toExponential(3).split("e");
      text = mantissa + " × 10" + raised(Number(power));
    }
    return minus(text) + (unit ? " " + unit : "");
  }
  function moment(seconds, step) {
    if (seconds == null) return "–";
    return new Date(seconds * 1000).toISOString().replace("T", " ").slice(0, step < 1 ? 23 : 19);
  }

  // ---- axes
  const DATES = [
    [31536000, "{YYYY}", null, null, null, null, null, null, 1],
    [2419200, "{MMM}", "\n{YYYY}", null, null, null, null, null, 1],
    [86400, "{D} {MMM}", "\n{YYYY}", null, null, null, null, null, 1],
    [3600, "{HH}:{mm}", "\n{D} {MMM} {YYYY}", null, "\n{D} {MMM}", null, null, null, 1],
    [60, "{HH}:{mm}", "\n{D} {MMM} {YYYY}", null, "\n{D} {MMM}", null, null, null, 1],
    [1, ":{ss}", "\n{D} {MMM} {YYYY} {HH}:{mm}", null, "\n{D} {MMM} {HH}:{mm}", null, "\n{HH}:{mm}", null, 1],
    [0.001, ":{ss}.{fff}", "\n{D} {MMM} {YYYY} {HH}:{mm}", null, "\n{D} {MMM} {HH}:{mm}", null, "\n{HH}:{mm}", null, 1],
  ];
  const linear = (scale) => (u, splits, i, space, step) => {
    const d = decimals(step / scale);
    return splits.map((v) => (v == null ? "" : minus((v / scale).toFixed(d))));
  };
  const padded = (u, low, high) => { // what differs in its last digits only is drawn as a line, on ticks that differ
    if (low == null) return [0, 1];
    const least = 1e-9 * Math.max(Math.abs(low), Math.abs(high), 1e-290), middle = (low + high) / 2;
    if (high - low < least) [low, high] = [middle - least / 2, middle + least / 2];
    const span = high - low;
    return span < 1e3 * least ? [low - 0.1 * span, high + 0.1 * span] : uPlot.rangeNum(low, high, 0.1, true);
  };
  const decade = (v) => v != null && Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-9;
  const decades = (u, splits) => splits.map((v) => (decade(v) ? v : null));
  const logarithmic = (scale) => (u, values) => {
    const splits = values.map((v) => (v == null ? v : v / scale)), known = splits.filter(decade), powers = known[0] < 2e-3 || known[known.length - 1] > 2e4;
    return splits.map((v) => {
      if (!decade(v)) return "";
      return powers ? "10" + raised(Math.round(Math.log10(v))) : String(Number(v.toPrecision(1)));
    });
  };
  const ladder = (u, i, low, high) => { // 1 to 9 times each power of ten
    const steps = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++) {
      for (let k = 1; k < 10; k++) if (k * 10 ** power >= low && k * 10 ** power <= high) steps.push(k * 10 ** power);
    }
    return steps;
  };
  function fitting(columns, unit, units) { // the unit that suits an axis, and its power of ten: as thermocorr.records.quantities
    let size = 0;
    for (const column of columns) for (const v of column) if (v != null && Math.abs(v) > size) size = Math.abs(v);
    if (size === 0) return [0, unit];
    if (units?.length) {
      if (size >= 0.1 && size < 1e4) return [0, unit];
      return units.findLast(([, , least]) => size >= least) ?? units[0];
    }
    const power = size >= 2e-3 && size < 1e6 ? 0 : 3 * Math.floor(Math.log10(size) / 3 + 1e-9);
    return [power, power ? "10" + raised(power) + (unit ? " " + unit : "") : unit];
  }
  const span = (seconds, { units }) => { // 900 s as 15 min
    const [unit, size] = units.find(([, least]) => seconds >= least * (1 - 1e-9)) ?? units[units.length - 1];
    return figure(Number((seconds / size).toPrecision(3)), unit);
  };
  const drawn = ({ fine, coarse }, low, high) => { // ticks of an axis of time spans
    const inside = (ticks) => ticks.filter((v) => v >= low && v <= high);
    return inside(fine).length > 7 ? inside(coarse) : inside(fine);
  };

  class Chart {
    // place: element to draw in; live: {zoomed(low, high), brushed(low, high)} for a chart whose data follow its zoom
    constructor(spec, place, live = {}) {
      this.spec = spec;
      this.place = place;
      this.live = live;
      this.x = places(spec.x.data);
      this.columns = spec.panels.map((panel) => panel.lines.map((line) => (
        line.stretches && !line.data.same ? held(line.stretches, values(line.data), this.x.length) : values(line.data))));
      this.panels = [];
      this.hosts = [];
      this.axis = 0; // common width of the vertical axes, so that panels stand in line
      this.quiet = false;
      this.brushing = false;
      charts[spec.name] = this;
      if (!live.zoomed && (spec.name === "series" || spec.name === "refined")) this.tools();
      for (const panel of spec.panels) {
        const host = document.createElement("div");
        host.className = "panel";
        this.place.append(host);
        this.hosts.push(host);
      }
      this.draw();
    }
    colour(role) {
      return getComputedStyle(this.place).getPropertyValue("--" + role).trim();
    }
    load(x, columns) { // other points of the same lines
      this.x = x;
      this.columns = columns;
      const { min, max } = this.panels[0].scales.x;
      this.quiet = true;
      this.panels.forEach((u, i) => {
        u.setData([x, ...columns[i]], false);
        u.setScale("x", { min, max });
      });
      this.quiet = false;
    }
    brush(on) { // whether dragging selects a stretch, instead of zooming into it
      this.brushing = on;
      this.panels.forEach((u) => { u.cursor.drag.setScale = !on; });
      if (!on) this.select(null);
    }
    select(range) { // show a stretch as selected; null for none
      this.quiet = true;
      for (const u of this.panels) {
        const [a, b] = range ? range.map((v) => u.valToPos(v, "x")) : [0, 0];
        u.setSelect({ left: Math.min(a, b), width: Math.abs(b - a), top: 0, height: range ? u.over.clientHeight : 0 }, false);
      }
      this.quiet = false;
    }
    brushed(u) {
      if (!this.brushing || this.quiet || u.select.width < 2) return;
      const range = [u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x")];
      this.select(range);
      if (this.live.brushed) this.live.brushed(...range);
    }
    remove() {
      this.panels.forEach((u) => u.destroy());
      this.place.replaceChildren();
      if (charts[this.spec.name] === this) delete charts[this.spec.name];
    }
    tools() {
      const bar = document.createElement("div");
      bar.className = "tools";
      const act = {
        "Whole record": () => this.zoom(),
        "Zoom in": () => this.step(0.25, 0.75),
        "Zoom out": () => this.step(-0.5, 1.5),
        "◀ Earlier": () => this.step(-0.5, 0.5),
        "Later ▶": () => this.step(0.5, 1.5),
      };
      for (const [name, run] of Object.entries(act)) {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = name;
        button.addEventListener("click", run);
        bar.append(button);
      }
      this.place.before(bar);
    }
    draw() {
      const kept = this.panels.length ? [this.panels[0].scales.x.min, this.panels[0].scales.x.max] : null;
      this.panels.forEach((u) => u.destroy());
      this.axis = 0;
      this.panels = [];
      this.spec.panels.forEach((panel, i) => {
        this.panels.push(new uPlot(this.options(panel, i), [this.x, ...this.columns[i]], this.hosts[i]));
      });
      if (kept) this.zoom(...kept);
    }
    rest() { // the point that legends tell of where nothing is pointed at: the last one
      const first = this.columns[0][0];
      let at = first.length - 1;
      while (at > 0 && first[at] == null) at--;
      return at;
    }
    ends() { // of the whole record
      return this.spec.ends || [this.x[0], this.x[this.x.length - 1]];
    }
    zoom(low = this.ends()[0], high = this.ends()[1]) {
      const [first, last] = this.ends();
      this.panels[0].setScale("x", { min: Math.max(low, first), max: Math.min(high, last) });
    }
    step(low, high) {
      const { min, max } = this.panels[0].scales.x, span = max - min;
      const [first, last] = this.ends(), wide = Math.min((high - low) * span, last - first);
      const from = Math.min(Math.max(min + low * span, first), last - wide);
      this.zoom(from, from + wide);
    }
    follow(u) { // one panel was zoomed: the others follow
      if (this.quiet) return;
      this.quiet = true;
      const { min, max } = u.scales.x;
      for (const other of this.panels) if (other !== u) other.setScale("x", { min, max });
      this.quiet = false;
      if (this.live.zoomed && min != null) this.live.zoomed(min, max);
    }
    width(i) {
      return Math.max(Math.floor(this.hosts[i].getBoundingClientRect().width), 200);
    }
    size(u, texts) { // width of a vertical axis
      if (!texts) return this.axis || 50;
      u.ctx.font = u.axes[1].font[0];
      const needed = Math.ceil(Math.max(...texts.map((t) => u.ctx.measureText(t).width)) / devicePixelRatio) + 14;
      if (needed > this.axis) {
        this.axis = needed;
        cancelAnimationFrame(this.pending);
        this.pending = requestAnimationFrame(() => this.panels.forEach((other) => other.redraw(false, true)));
      }
      return this.axis;
    }
    when(v, step) { // x as a person writes it; the true time where segments were moved
      const { dates, unit, joints, spans } = this.spec.x;
      if (dates || v == null) return moment(v, step);
      if (spans) return span(v, spans);
      const joint = joints.findLast((pair) => pair[0] <= v);
      if (!joint) return figure(v, unit);
      const size = { ms: 1e-3, s: 1, min: 60, h: 3600, d: 86400, y: 31557600 }[unit];
      return joint[1] > 1e7 ? moment(joint[1] + (v - joint[0]) * size, step * size) : figure(joint[1] + v - joint[0], unit);
    }
    title(panel, unit) { // a name too long for the axis stands in the legend alone
      const whole = panel.label + (unit ? " [" + unit + "]" : "");
      return whole.length * 6.6 < panel.height - 24 ? whole : unit ? "[" + unit + "]" : "";
    }
    options(panel, i) {
      const { spec } = this, last = i === spec.panels.length - 1;
      const plain = panel.log && !panel.units?.length; // powers of ten stand at the ticks
      const [power, unit] = plain ? [0, panel.unit] : fitting(this.columns[panel.like ?? i], panel.unit, panel.units);
      const scale = 10 ** power, prefixed = panel.units?.some(([, text]) => text === unit);
      const text = this.colour("text"), grid = { stroke: this.colour("grid"), width: 1 }, ticks = { stroke: this.colour("grid"), width: 1, size: 5 };
      const font = "12px " + getComputedStyle(this.place).fontFamily;
      const gridded = (log) => (log ? { ...grid, filter: decades } : grid);
      const xs = { stroke: text, grid: spec.x.spans ? grid : gridded(spec.x.log), ticks, font, labelFont: font, space: 70 };
      if (last) { xs.label = spec.x.label + (spec.x.unit && !spec.x.spans ? " [" + spec.x.unit + "]" : ""); xs.labelSize = 18; xs.labelGap = 2; }
      if (spec.x.dates) xs.values = DATES;
      else xs.values = spec.x.log ? logarithmic(1) : linear(1);
      if (spec.x.spans) {
        xs.splits = (u, k, low, high) => drawn(spec.x.spans, low, high);
        xs.values = (u, splits) => splits.map((v) => span(v, spec.x.spans));
        xs.filter = (u, splits) => splits;
      } else if (spec.x.log) { xs.splits = ladder; xs.filter = (u, splits) => splits; }
      if (!last) { xs.values = (u, splits) => splits.map(() => ""); xs.size = 8; }
      else xs.size = spec.x.dates ? 40 : 28;
      const step = this.x.length > 1 ? this.x[1] - this.x[0] : 1;
      return {
        width: this.width(i),
        height: panel.height + (last ? 48 : 0),
        padding: [10, 20, 0, 0],
        tzDate: (seconds) => uPlot.tzDate(new Date(seconds * 1000), "Etc/UTC"),
        cursor: { y: false, ...(this.live.zoomed ? { bind: { dblclick: () => () => this.zoom() } } : {}), sync: { key: spec.name, scales: ["x", null] }, drag: { x: true, y: false }, points: { size: 7 } },
        legend: { live: true, markers: { width: 0, fill: (u, k) => this.colour(panel.lines[k - 1].role) } },
        bands: panel.lines.flatMap((line, k) => (line.edge && !panel.lines[k - 1].edge ? [{ series: [k + 2, k + 1], fill: this.colour(line.role) + "38" }] : [])),
        scales: {
          x: spec.x.log ? { time: false, distr: 3, range: (u, low, high) => [low / 1.15, high * 1.15] } : { time: spec.x.dates },
          y: { distr: panel.log ? 3 : 1, range: panel.like == null ? (panel.log ? undefined : padded) : () => {
            const { min, max } = this.panels[panel.like].scales.y;
            return [min, max];
          } },
        },
        axes: [xs, {
          stroke: text, grid: gridded(panel.log), ticks, font, labelFont: font, space: panel.dense ? 20 : 34, labelSize: 20, labelGap: 2,
          label: this.title(panel, unit),
          values: panel.log ? logarithmic(scale) : linear(scale),
          size: (u, texts) => this.size(u, texts),
        }],
        series: [
          { label: spec.name === "series" || spec.name === "refined" ? "time" : spec.x.label, value: (u, v, k, at) => this.when(at == null ? this.x[this.rest()] : v, step) },
          ...panel.lines.map((line, k) => ({
            label: line.label,
            class: line.edge ? "edge" : undefined,
            stroke: line.edge ? "transparent" : this.colour(line.role),
            paths: line.joined ? undefined : () => null,
            width: line.role === "average" ? 2 : 1.2,
            spanGaps: Boolean(line.spanned),
            dash: line.dash ? [6, 4] : undefined,
            points: line.edge || line.dash ? { show: false } : line.dots ? { show: true, size: line.joined ? 6 : 4, width: 0, fill: this.colour(line.role) } : undefined,
            value: (u, given, of, at) => {
              const v = at == null ? this.columns[i][k][this.rest()] : given;
              return prefixed && v != null ? figure(v / scale, unit, digits(u)) : figure(v, panel.unit, digits(u));
            },
          })),
        ],
        hooks: {
          setScale: [(u, key) => { if (key === "x" && this.panels.length) this.follow(u); }],
          setSelect: [(u) => this.brushed(u)],
          drawClear: [(u) => this.shades(u)],
          draw: [(u) => this.rules(u, panel)],
        },
      };
    }
    shades(u) {
      const { left, top, width, height } = u.bbox;
      u.ctx.save();
      u.ctx.fillStyle = this.colour("shade");
      const fill = ([low, high]) => {
        const a = Math.max(u.valToPos(low, "x", true), left), b = Math.min(u.valToPos(high, "x", true), left + width);
        if (b > a) u.ctx.fillRect(a, top, b - a, height);
      };
      this.spec.shades.forEach(fill);
      u.ctx.fillStyle = this.colour("line");
      (this.spec.out || []).forEach(fill); // what is left out
      u.ctx.restore();
    }
    rules(u, panel) {
      const { left, top, width, height } = u.bbox;
      u.ctx.save();
      u.ctx.strokeStyle = this.colour("floor");
      u.ctx.lineWidth = 1.5 * devicePixelRatio;
      u.ctx.setLineDash([6 * devicePixelRatio, 5 * devicePixelRatio]);
      for (const value of panel.rules) {
        const y = u.valToPos(value, "y", true);
        if (y < top || y > top + height) continue;
        u.ctx.beginPath();
        u.ctx.moveTo(left, y);
        u.ctx.lineTo(left + width, y);
        u.ctx.stroke();
      }
      u.ctx.restore();
    }
  }

  function fitted(at) { // charts take the width of their places, when that changes
    let waiting = 0;
    const resized = () => Object.values(charts).forEach((chart) => chart.panels.forEach((u, i) => {
      if (u.width !== chart.width(i)) u.setSize({ width: chart.width(i), height: u.height });
    }));
    new ResizeObserver(() => {
      cancelAnimationFrame(waiting);
      waiting = requestAnimationFrame(resized);
    }).observe(at);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => Object.values(charts).forEach((c) => c.draw()));
  }

  Object.assign((window.thermocorr ??= {}), { Chart, charts, values, places, figure, moment, fitted });
})();
