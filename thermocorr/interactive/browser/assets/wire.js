"use strict";
// The line to the program: acts, pieces of curves, and news as it comes.
(() => {
  const tc = (window.thermocorr ??= {});

  class Refused extends Error {}
  class Gone extends Refused {} // of a state that another one is about to follow: not worth a word

  class Wire {
    constructor(heard) {
      this.heard = heard;
      this.pieces = new AbortController();
      this.source = new EventSource("/events");
      for (const kind of ["state", "progress", "ended"]) {
        this.source.addEventListener(kind, (event) => {
          if (kind === "ended") this.source.close();
          heard(kind, JSON.parse(event.data));
        });
      }
      this.source.onerror = () => {
        if (this.source.readyState === EventSource.CLOSED) heard("ended", {});
        else heard("progress", { text: "waiting for the program" });
      };
    }
    async asked(path, how = {}) {
      let answer;
      try {
        answer = await fetch(path, { credentials: "same-origin", ...how });
      } catch (error) {
        if (error.name === "AbortError") throw error;
        throw new Refused("The program does not answer. Has it been ended?");
      }
      const text = await answer.text();
      let content;
      try { content = JSON.parse(text); } catch { content = { problem: text.trim() }; }
      if (answer.status === 404) throw new Gone(content.problem || "This is no longer there.");
      if (!answer.ok) throw new Refused(content.problem || `The program answers ${answer.status}.`);
      return content;
    }
    ask(asked, revision) {
      return this.asked("/api/do", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ ...asked, revision }) });
    }
    cancel() { return this.asked("/api/cancel", { method: "POST" }); }
    open(file) { return this.asked(`/api/open?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file }); }
    sample(name) { return this.asked(`/api/open?sample=${encodeURIComponent(name)}`, { method: "POST" }); }
    piece(query, signal) { return this.asked(`/api/piece?${new URLSearchParams(query)}`, { signal }); }
    cloud(query) { return this.asked(`/api/cloud?${new URLSearchParams(query)}`); }
    charts(key) { return this.asked(`/api/charts?${new URLSearchParams({ key })}`); }
    async take(kind) {
      const link = tc.element("a", { href: `/take/${kind}`, download: "" });
      const answer = await fetch(link.href, { credentials: "same-origin" });
      if (!answer.ok) {
        const text = await answer.text();
        let problem = text.trim();
        try { problem = JSON.parse(text).problem; } catch { /* plain text */ }
        throw new Refused(problem);
      }
      const name = /filename="([^"]+)"/.exec(answer.headers.get("content-disposition") || "")?.[1] || kind;
      tc.saved(name, await answer.blob());
    }
  }

  Object.assign(tc, { Wire, Gone });
})();
