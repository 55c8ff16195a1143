"use strict";
// The page without a server: a worker in the browser holds the desk. Cancelled, it is ended, and the steps are replayed.
(() => {
  const tc = window.thermocorr;
  const root = document.querySelector(".workbench");
  const begin = new Blob([`import ${JSON.stringify(new URL("desk_worker.mjs", document.baseURI).href)};`], { type: "text/javascript" });

  class WorkerWire extends tc.DeskWire {
    constructor(heard) {
      const port = { listen: (hear) => { port.hear = hear; }, send: (message, along) => this.worker.postMessage({ message, along }) };
      super(port, heard);
      this.heard = heard;
      this.begin();
    }
    begin() { // a worker of a blob obeys the page's content security policy
      this.turn = (this.turn ?? 0) + 1;
      this.worker = new Worker(URL.createObjectURL(begin), { type: "module" });
      this.worker.onmessage = ({ data }) => {
        if (data.began) this.heard("progress", { text: data.began === "ready" ? "" : data.began });
        else if (data.broken) this.broken(data.broken);
        else this.port.hear(data);
      };
      this.worker.onerror = (error) => this.broken(`The page cannot go on: ${error.message}. Load it again.`);
      this.worker.postMessage({ base: document.baseURI });
    }
    broken(text) {
      this.refuse(text);
      this.heard("progress", { text: "" });
      tc.bench?.trouble(text);
    }
    async asked(what, given, along) {
      const answer = await super.asked(what, given, along);
      if (answer?.past) this.past = answer.past;
      return answer;
    }
    open(file) { return this.opened({ file }); }
    async opened(log) {
      const turn = this.turn;
      const along = log.file ? { name: log.file.name, bytes: await log.file.arrayBuffer() } : null;
      if (turn !== this.turn) return null; // cancelled meanwhile
      const given = { path: along ? `/log/${along.name}` : "", past: log.past ?? null, idle: Boolean(log.idle) };
      const answer = await this.asked("open", given, along);
      this.log = log;
      return answer;
    }
    async cancel() { // the steps that stood come again, and nothing is begun by itself
      this.worker.terminate();
      this.begin();
      this.refuse("Cancelled: everything stands as it was.");
      try { if (this.log) await this.opened({ ...this.log, past: this.past, idle: true }); } catch (error) { tc.bench.trouble(error.message); }
    }
  }

  tc.bench = new tc.Workbench(root, (heard) => new WorkerWire(heard));
})();
