"use strict";
// The line to the desk of the program: messages by requests, and news as it comes.
(() => {
  const tc = window.thermocorr;
  const { DeskWire, Refused } = tc;

  class ServerWire extends DeskWire {
    constructor(heard) {
      super({ listen() {} }, heard);
      const source = new EventSource("/events");
      for (const kind of ["state", "progress", "ended"]) {
        source.addEventListener(kind, (event) => {
          if (kind === "ended") source.close();
          heard(kind, JSON.parse(event.data));
        });
      }
      source.onerror = () => {
        if (source.readyState === EventSource.CLOSED) heard("ended", {});
        else heard("progress", { text: "waiting for the program" });
      };
    }
    async post(path, how = {}) {
      let answer;
      try {
        answer = await fetch(path, { method: "POST", credentials: "same-origin", ...how });
      } catch {
        throw new Refused("The program does not answer. Has it been ended?");
      }
      const text = await answer.text();
      let content;
      try { content = JSON.parse(text); } catch { content = { problem: text.trim() }; }
      if (!answer.ok) throw new Refused(content.problem || `The program answers ${answer.status}.`, content.remedy);
      return content;
    }
    asked(what, given) { return this.post("/api/say", { headers: { "Content-Type": "application/json" }, body: JSON.stringify({ what, given }) }); }
    cancel() { return this.post("/api/cancel"); }
    open(file) { return this.post(`/api/open?name=${encodeURIComponent(file.name)}`, { body: file }); }
    mend() { return this.post("/api/open?remedy=1"); }
  }

  tc.ServerWire = ServerWire;
})();
