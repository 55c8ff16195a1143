"use strict";
// The screen in a notebook: its line to the program is the kernel's.
(() => {
  const tc = (window.thermocorr ??= {});
  const { element } = tc;

  class Refused extends Error {}

  class NotebookWire {
    constructor(model, heard) {
      this.model = model;
      this.number = 0;
      this.waiting = new Map();
      model.on("msg:custom", (message) => {
        if (message.kind === "state" || message.kind === "progress") { heard(message.kind, message.content); return; }
        const asked = this.waiting.get(message.number);
        this.waiting.delete(message.number);
        if (!asked) return;
        if (message.kind === "done") asked.resolve(message.content);
        else asked.reject(new Refused(message.problem));
      });
    }
    asked(what, given) {
      const number = ++this.number;
      return new Promise((resolve, reject) => {
        this.waiting.set(number, { resolve, reject });
        this.model.send({ what, number, given });
      });
    }
    ask(asked) { return this.asked("do", asked); }
    piece(query) { return this.asked("piece", Object.fromEntries(Object.entries(query).map(([key, value]) => [key, String(value)]))); }
    cloud(query) { return this.asked("cloud", query); }
    charts(key) { return this.asked("charts", { key }); }
    async take(kind) {
      const { name, media, content } = await this.asked("take", { kind });
      const raw = atob(content);
      tc.saved(name, new Blob([Uint8Array.from(raw, (sign) => sign.charCodeAt(0))], { type: media }));
    }
  }

  tc.render = ({ model, el }) => {
    const root = element("div", { class: "workbench" });
    root.innerHTML = model.get("body"); // the same for every log: nothing of the user's is in it
    el.replaceChildren(root);
    const bench = new tc.Workbench(root, (heard) => new NotebookWire(model, heard));
    tc.bench = bench;
    tc.fitted(root);
    bench.wire.asked("ready", {});
    return () => { bench.plot.clear(); bench.views.chart?.remove(); };
  };
})();
