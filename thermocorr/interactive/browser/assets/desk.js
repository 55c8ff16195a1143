"use strict";
// The line to a desk: messages to a kernel or a worker, and its answers by their numbers.
(() => {
  const tc = (window.thermocorr ??= {});

  class Refused extends Error {}
  class Gone extends Refused {} // of a state that another one is about to follow: not worth a word

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
        else asked.reject(new (message.gone ? Gone : Refused)(message.problem));
      });
    }
    asked(what, given, along) {
      const number = ++this.number;
      return new Promise((resolve, reject) => {
        this.waiting.set(number, { resolve, reject });
        this.port.send({ what, number, given }, along);
      });
    }
    refuse(text) { // whatever was asked is not answered any more
      for (const { reject } of this.waiting.values()) reject(new Refused(text));
      this.waiting.clear();
    }
    ask(asked, revision) { return this.asked("do", { ...asked, revision }); }
    piece(query) { return this.asked("piece", Object.fromEntries(Object.entries(query).map(([key, value]) => [key, String(value)]))); }
    cloud(query) { return this.asked("cloud", query); }
    charts(key) { return this.asked("charts", { key }); }
    async take(kind) {
      const { name, media, content } = await this.asked("take", { kind });
      const raw = atob(content);
      tc.saved(name, new Blob([Uint8Array.from(raw, (sign) => sign.charCodeAt(0))], { type: media }));
    }
  }

  Object.assign(tc, { DeskWire, Refused, Gone });
})();
