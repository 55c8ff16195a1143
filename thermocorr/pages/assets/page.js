"use strict";
(() => {
  const root = document.documentElement;
  const { Chart, charts, fitted } = window.thermocorr;
  const specs = JSON.parse(document.getElementById("charts").textContent);
  const every = (run) => Object.values(charts).forEach(run);
  for (const spec of specs) new Chart(spec, document.getElementById("chart-" + spec.name));
  for (const button of document.querySelectorAll("button.show")) {
    button.addEventListener("click", () => {
      const chart = charts.series;
      const low = Number(button.dataset.from), high = Number(button.dataset.to), margin = 0.25 * (high - low);
      chart.zoom(low - margin, high + margin);
      chart.place.closest("figure").scrollIntoView({ block: "start" });
    });
  }
  fitted(document.body);
  const paper = (on) => { // light colours and the width of a page, details open
    if (on) root.dataset.print = "1"; else delete root.dataset.print;
    for (const part of document.querySelectorAll("details:not(.long)")) {
      if (on && !part.open) { part.open = true; part.dataset.opened = "1"; }
      else if (!on && part.dataset.opened) { part.open = false; delete part.dataset.opened; }
    }
    document.body.style.width = on ? "660px" : "";
    every((chart) => chart.draw());
  };
  addEventListener("beforeprint", () => paper(true));
  addEventListener("afterprint", () => paper(false));
  requestAnimationFrame(() => requestAnimationFrame(() => { root.dataset.ready = String(Math.round(performance.now())); }));
})();
