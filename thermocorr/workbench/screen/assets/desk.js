"use strict";
// The line to a desk: messages to a kernel or a worker, and its answers by their numbers.
(() => {
  const tc = (window.thermocorr ??= {});

  class Refused extends Error { // with what a button says that would mend it
    constructor(problem, remedy = "") { super(problem); this.remedy = remedy; }
  }

  class DeskWire { // port: { send(message), listen(heard) }
    constructor(port, heard) {
      this.port = port;
      this.number = 0;
      this.waiting = new Map();
      port.listen((message) => {
        if (message.kind === "state" || message.kind === "progress") { heard(message.kind, message.content); return; }
        const asked = this.waiting.get(message.number);
        this.waiting.delete(message.number);
        if (!asked) return;
        if (message.kind === "done") asked.resolve(message.content);
        else asked.reject(new Refused(message.problem, message.remedy));
      });
    }
    asked(what, given, along) {
      const number = ++this.number;
      return new Promise((resolve, reject) => {
        this.waiting.set(number, { resolve, reject });
        this.port.send({ what, number, given }, along);
      });
    }
    mend() { return this.asked("remedy", { remedy: true }); }
    refuse(text) { // whatever was asked is not answered any more
      for (const { reject } of this.waiting.values()) reject(new Refused(text));
      this.waiting.clear();
    }
  }

  Object.assign(tc, { DeskWire, Refused });
})();
