"use strict";
// The page in a browser.
(() => {
  const { Workbench, Wire, fitted } = window.thermocorr;
  const root = document.querySelector(".workbench");
  window.thermocorr.bench = new Workbench(root, (heard) => new Wire(heard));
  fitted(root);
})();
