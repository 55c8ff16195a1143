"use strict";
// The page in a browser.
(() => {
  const { Workbench, ServerWire } = window.thermocorr;
  const root = document.querySelector(".workbench");
  window.thermocorr.bench = new Workbench(root, (heard) => new ServerWire(heard));
})();
