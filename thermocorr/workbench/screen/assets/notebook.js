"use strict";
// The screen in a notebook: its line to the desk is the kernel's.
(() => {
  const tc = (window.thermocorr ??= {});
  const { element } = tc;

  tc.render = ({ model, el }) => {
    const root = element("div", { class: "workbench" });
    root.innerHTML = model.get("body"); // the same for every log: nothing of the user's is in it
    el.replaceChildren(root);
    const bench = new tc.Workbench(root, (heard) => new tc.DeskWire({ send: (message) => model.send(message), listen: (hear) => model.on("msg:custom", hear) }, heard));
    tc.bench = bench;
    bench.wire.asked("ready", {});
  };
})();
