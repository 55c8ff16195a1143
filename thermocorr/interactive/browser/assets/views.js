"use strict";
// Below the time plot: the residual against anything, and the charts of the report page.
(() => {
  const tc = (window.thermocorr ??= {});
  const { Chart, element, values } = tc;
  const NAMES = { allan: "Allan deviation", step: "Step response" };

  class Views {
    constructor(place, wire, troubled) {
      Object.assign(this, { place, wire, troubled });
      this.tabs = element("div", { class: "tabs", role: "tablist", "aria-label": "pictures" });
      this.tools = element("div", { class: "tools" });
      this.body = element("div", { class: "chart", role: "tabpanel", "aria-label": "picture" });
      this.caption = element("p", { class: "fine" });
      place.replaceChildren(this.tabs, this.tools, this.body, this.caption);
      this.tab = "cloud";
      this.across = "temperature";
      this.range = null; // what stands out in the cloud
      this.known = {};
    }
    async show(state) {
      const fitted = state.fitted;
      this.fitted = fitted;
      this.ready = Boolean(fitted && state.charts.includes(fitted.key));
      if (!fitted) { this.chart?.remove(); this.chart = null; this.shown = ""; this.tabs.replaceChildren(); this.tools.replaceChildren(); this.caption.textContent = ""; return; }
      if (!fitted.curves.some((curve) => curve.name === this.across)) { this.across = "temperature"; this.range = null; }
      if (this.ready && this.known.key !== fitted.key) {
        try { this.known = { key: fitted.key, charts: await this.wire.charts(fitted.key) }; } catch (error) { this.troubled(error); return; }
      }
      if (this.fitted === fitted) this.draw();
    }
    charts() { return this.ready && this.known.key === this.fitted.key ? this.known.charts : []; }
    choose(tab) { this.tab = tab; this.draw(); this.tabs.querySelector(`[data-tab="${tab}"]`)?.focus(); }
    against(curve, range = null) { // the residual over this curve, a range of it standing out
      this.across = curve;
      this.range = range;
      this.tab = "cloud";
      this.draw();
    }
    draw() {
      const charts = this.charts();
      if (this.ready && this.tab !== "cloud" && !charts.some((chart) => chart.name === this.tab)) this.tab = "cloud";
      const there = new Set(["cloud", ...charts.map((chart) => chart.name)]);
      const tabs = [["cloud", "Residual against…"], ...Object.entries(NAMES)].filter(([name]) => !this.ready || there.has(name));
      this.tabs.replaceChildren(...tabs.map(([name, text], i) => element("button", {
        type: "button", role: "tab", disabled: !there.has(name), "data-tab": name, "aria-selected": String(name === this.tab), tabindex: name === this.tab ? 0 : -1,
        onclick: () => this.choose(name),
        onkeydown: (event) => {
          const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
          if (step) this.choose(tabs[(i + step + tabs.length) % tabs.length][0]);
        },
      }, text)));
      const signature = JSON.stringify([this.fitted.key, this.tab, this.across, this.range]);
      if (this.tab === "cloud") this.cloud(signature);
      else if (signature !== this.shown) {
        const chart = charts.find((one) => one.name === this.tab);
        if (!chart) return;
        this.tools.replaceChildren();
        this.put(chart, chart.caption, signature);
      }
    }
    put(spec, caption, signature) {
      this.chart?.remove();
      this.body.replaceChildren();
      this.chart = new Chart(spec, this.body);
      this.caption.textContent = caption;
      this.shown = signature;
      this.body.dataset.drawn = spec.name;
    }
    async cloud(signature) {
      const curves = this.fitted.curves, fitted = this.fitted;
      const groups = { condition: "conditions", column: "columns", contribution: "contributions of effects" };
      const select = element("select", { "data-at": "across", onchange: (event) => this.against(event.target.value) });
      for (const [group, label] of Object.entries(groups)) {
        const own = curves.filter((curve) => curve.group === group);
        if (own.length) select.append(element("optgroup", { label }, own.map((curve) => element("option", { value: curve.name }, curve.label))));
      }
      select.value = this.across;
      if (!this.tools.contains(document.activeElement)) this.tools.replaceChildren(element("label", {}, "over ", select));
      if (signature === this.shown || signature === this.fetching) return;
      this.fetching = signature;
      let found;
      try { found = await this.wire.cloud({ key: fitted.key, across: this.across, up: "residual" }); } catch (error) { if (this.fitted === fitted) this.troubled(error); return; } finally { this.fetching = ""; }
      if (this.fitted !== fitted || this.tab !== "cloud" || signature !== JSON.stringify([fitted.key, this.tab, this.across, this.range])) return;
      const curve = curves.find((one) => one.name === this.across);
      this.put(cloudSpec(found, curve, fitted, this.range), "Points: some of the rows. Line: mean residual of all rows in each range, with a band of twice its error as if the noise were white. A line that leaves zero is a law that the model does not have.", signature);
    }
  }

  // Points, and the means of bins, merged over one x that never decreases.
  function cloudSpec(found, curve, { unit, units }, range) {
    const [x, y, center, mean, error] = ["x", "y", "center", "mean", "error"].map((name) => values(found[name]));
    const rows = [...x.map((v, i) => [v, y[i], null, null]), ...center.map((v, i) => [v, null, mean[i], error[i]])].sort((a, b) => a[0] - b[0]);
    const column = (pick) => ({ ready: rows.map(pick) });
    const edge = (sign, label) => ({ label, role: "model", edge: true, joined: true, spanned: true, data: column((r) => (r[2] == null ? null : r[2] + sign * 2 * r[3])) });
    return {
      name: "cloud",
      x: { label: curve.label, unit: curve.unit, joints: [], dates: false, log: false, data: { ready: Float64Array.from(rows, (r) => r[0]) } },
      panels: [{ label: "residual", unit, units, log: false, like: null, height: 230, rules: [0], lines: [
        { label: "rows", role: "residual", dots: true, joined: false, data: column((r) => r[1]) },
        { label: "mean", role: "model", joined: true, spanned: true, data: column((r) => r[2]) },
        edge(-1, "low"), edge(1, "high"),
      ] }],
      shades: range ? [range] : [],
    };
  }

  tc.Views = Views;
})();
