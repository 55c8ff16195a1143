"use strict";
// The page in a browser.
(() => {
  const { Workbench, ServerWire, fitted } = window.thermocorr;
  const root = document.querySelector(".workbench");
  window.thermocorr.bench = new Workbench(root, (heard) => new ServerWire(heard));
  fitted(root);
})();
