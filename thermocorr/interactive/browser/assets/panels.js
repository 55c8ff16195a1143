"use strict";
// The lists at the sides: columns, model, history; verdict, places, suspects. Each is a function of the state.
(() => {
  const tc = (window.thermocorr ??= {});
  const { element, number, bar } = tc;
  const CARDS = 3; // causes that are shown unfolded
  const UNPROVEN = { confirmed: "", helps: "helps; cause not proven", proven: "proven, not confirmed" };
  const ROLES = { suspect: "suspect", temperature: "temperature", reading: "reading", reference: "reference", time: "time", run: "run", ignored: "ignore" };

  const details = (summary, open, ...children) => element("details", { open }, element("summary", {}, summary), ...children);

  function columns(state, act) {
    const selects = new Map();
    const may = { number: true, switch: true };
    const table = element("table", { class: "columns" }, element("caption", { class: "unseen" }, "columns of the log and their roles"), element("tbody", {}, state.columns.map((column) => {
      const select = element("select", { "aria-label": `role of ${column.shown}`, "data-at": `role ${column.name}` });
      for (const [role, text] of Object.entries(ROLES)) {
        if (["temperature", "reading", "reference"].includes(role) && !may[column.kind] && column.role !== role) continue;
        select.append(element("option", { value: role }, text));
      }
      select.value = column.role;
      selects.set(column.name, select);
      const missing = column.missing ? element("small", {}, `${column.missing} missing`) : null;
      return element("tr", {}, element("th", { scope: "row" }, column.shown, column.unit && !column.shown.includes(column.unit) ? element("span", { class: "soft" }, ` [${column.unit}]`) : null, missing), element("td", {}, select));
    })));
    const refused = element("p", { class: "ask", role: "alert", "data-at": "refused" });
    const apply = () => {
      refused.textContent = "";
      const of = (role) => [...selects].filter(([, select]) => select.value === role).map(([name]) => name);
      for (const role of ["temperature", "reading", "reference", "time", "run"]) {
        if (of(role).length > 1) { refused.textContent = `Several columns are to be the ${role}: ${of(role).join(", ")}. Only one can.`; return; }
      }
      const temperature = of("temperature")[0] ?? (of("reference").length ? of("reading")[0] : undefined); // a thermometer that heats itself
      if (!temperature || !of("reading").length) { refused.textContent = "Say which column is the temperature and which the reading."; return; }
      act.do({ do: "columns", temperature, reading: of("reading")[0], reference: of("reference")[0] ?? null, time: of("time")[0] ?? null, run: of("run")[0] ?? null, ignored: of("ignored") }, (text) => { refused.textContent = text; });
    };
    return [
      element("h2", {}, "Columns"),
      state.decided ? null : element("p", { class: "ask" }, "Which column is the temperature, and which the reading?"),
      table,
      element("button", { type: "button", "data-at": "columns", onclick: apply }, "Apply"),
      refused,
      state.fitted?.without_times ? element("p", { class: "ask" }, "No column of times is set: rows count as 1 s apart. Set it above, or give the command --sampling-period.") : null,
      state.source.said.length ? element("p", { class: "fine" }, `Read as: ${state.source.said.join(", ")}.`) : null,
    ];
  }

  function model(state, act) {
    const { time_constants, degree, products } = state.model;
    const taus = element("input", { type: "text", value: String(time_constants), "data-at": "taus", "aria-describedby": "taus-help" });
    const power = element("input", { type: "number", min: 0, max: 9, value: degree, "data-at": "degree" });
    const pairs = element("select", { "data-at": "products" }, Object.entries({ 0: "none", 2: "of two", 3: "of two and three" }).map(([value, text]) => element("option", { value }, text)));
    pairs.value = String(Number(products) === 1 ? 2 : Number(products));
    const fitted = state.fitted;
    return details("Model", false,
      element("label", {}, "time constants ", taus), element("p", { class: "fine", id: "taus-help" }, "how many to choose, auto, none, or which: 60, 15min, 2h"),
      element("label", {}, "degree of the static law ", power),
      element("label", {}, "products of lags ", pairs),
      element("button", { type: "button", "data-at": "shape", onclick: () => act.do({ do: "shape", time_constants: taus.value, degree: Number(power.value), products: Number(pairs.value) || false }) }, "Apply"),
      fitted ? element("p", { class: "fine" }, `Chosen: ${fitted.time_constants || "no time constants"}.`) : null,
      fitted ? element("pre", { tabindex: 0, "aria-label": "formula" }, fitted.equation) : null,
    );
  }

  function history(state, act, chosen) {
    const rows = state.history, known = rows.map((row) => row.later?.value).filter((v) => v != null);
    const longest = Math.max(...known, 1e-300), floor = state.judged?.floor?.value;
    const list = element("ol", { class: "steps" }, rows.map((row) => {
      const share = row.later ? row.later.value / longest : 0, now = row.step === rows.length;
      const buttons = element("span", { class: "acts" });
      if (rows.length > 1) buttons.append(element("button", { type: "button", class: "plain", "data-at": `compare ${row.step}`, "aria-pressed": String(chosen.includes(row.key)), onclick: () => act.compare(row) }, "compare"));
      if (row.kind !== "columns") buttons.append(element("button", { type: "button", class: "plain", "data-at": `drop ${row.step}`, "aria-label": `remove step ${row.step}: ${row.text}`, onclick: () => act.do({ do: "drop", step: row.step - 1 }) }, "remove"));
      return element("li", { "aria-current": now ? "step" : false },
        element("div", { class: "what" }, row.text, " ", buttons),
        element("div", { class: "error" }, bar(share, "error on later data", floor ? floor / longest : null), " ", number(row.later, "…"), " ", row.db ? element("strong", { class: row.db.value < 0 ? "good" : "bad" }, number(row.db)) : null),
        element("div", { class: "fine" }, "held out ", number(row.held_out), ", in sample ", number(row.rms), row.same ? null : "; learned from other readings: not compared"),
      );
    }));
    return [
      element("h2", {}, "Steps"),
      rows.length ? element("p", { class: "fine" }, "Rms error on later stretches, each predicted from everything before; the mark is the noise floor.") : element("p", { class: "fine" }, "None yet."),
      list,
      compared(rows.filter((row) => chosen.includes(row.key))),
      element("div", { class: "tools" },
        element("button", { type: "button", "data-at": "undo", disabled: !state.can_undo, "aria-keyshortcuts": "Control+Z", onclick: () => act.do({ do: "undo" }) }, "Undo"),
        element("button", { type: "button", "data-at": "redo", disabled: !state.can_redo, "aria-keyshortcuts": "Control+Y", onclick: () => act.do({ do: "redo" }) }, "Redo")),
    ];
  }

  // Two steps side by side.
  function compared(pair) {
    if (pair.length === 1) return element("p", { class: "fine" }, `Step ${pair[0].step} is chosen: choose another one to compare it with.`);
    if (pair.length !== 2) return null;
    const [one, other] = pair;
    const row = ([text, name]) => element("tbody", {},
      element("tr", {}, element("th", { scope: "rowgroup", colspan: 2, class: "soft" }, text)),
      element("tr", {}, element("td", {}, number(one[name])), element("td", {}, number(other[name]))));
    const head = pair.map((step) => element("th", { scope: "col" }, `step ${step.step}`));
    return element("table", { class: "compared" }, element("thead", {}, element("tr", {}, head)), [["later", "later"], ["held out", "held_out"], ["in sample", "rms"]].map(row));
  }

  function verdict(state, act) {
    const { judged, lacking, fitted } = state;
    const notes = fitted?.notes.length ? details(`${fitted.notes.length} ${fitted.notes.length === 1 ? "note" : "notes"} on the fit`, false, element("ul", {}, fitted.notes.map((note) => element("li", {}, note)))) : null;
    const again = element("button", { type: "button", "data-at": "judge", onclick: () => act.do({ do: "judge" }) }, "Judge again");
    if (!fitted) return [element("h2", {}, "Is anything missing?"), element("p", { class: "soft" }, "There is no model yet.")];
    if (!judged) return [element("h2", {}, "Is anything missing?"), element("p", { class: "soft" }, lacking.diagnosis || "Looking…"), lacking.diagnosis ? again : null, notes];
    return [
      element("h2", {}, "Is anything missing?"),
      element("p", {}, element("strong", { class: "verdict", "data-verdict": judged.verdict, "data-calm": judged.calm }, judged.verdict), " ", judged.said),
      element("p", { class: "figures" }, "Residual ", number(judged.rms), ", noise floor ", number(judged.floor), `: ${judged.explainable} of its variance could still be explained.`),
      judged.left.length ? element("p", { class: "fine" }, judged.left.join(" ")) : null,
      lacking.errors ? element("p", { class: "fine" }, `No error on other data: ${lacking.errors}`) : null,
      lacking.errors ? again : null,
      notes,
    ];
  }

  function where(state, act) {
    const judged = state.judged;
    if (!judged) return [];
    const calm = judged.calm, longest = Math.max(...judged.where.map((place) => place.share.value), 1e-300);
    if (!judged.where.length || calm) return [element("h2", {}, "Where does it fail?"), element("p", { class: "fine" }, "Nowhere more than noise does.")];
    const listed = (places, first) => element("ul", { class: "places" }, places.map((place, k) => {
        const i = first + k;
        const can = place.from_to || place.curve, text = `${place.aspect}: ${place.interval}`;
        const name = [text, " ", can ? element("button", { type: "button", class: "plain", "data-at": `place ${i}`, "aria-label": `show where ${text}`, onclick: () => act.go(place) }, "show") : null];
        return element("li", {}, name, element("div", {}, bar(place.share.value / longest, "share of the error", place.rows.value / longest), " ", element("span", { class: "fine" }, number(place.share), ", of the rows ", number(place.rows))));
      }));
    return [
      element("h2", {}, "Where does it fail?"),
      element("p", { class: "fine" }, "Share of the error beyond the noise; the mark is the share of the rows."),
      listed(judged.where.slice(0, 6), 0),
      judged.where.length > 6 ? details(`${judged.where.length - 6} more places`, false, listed(judged.where.slice(6), 6)) : null,
    ];
  }

  function suspects(state, act) {
    const judged = state.judged;
    if (!judged) return [];
    const causes = judged.suspects.filter((one) => one.cause).length;
    const item = (one, i) => {
      const preview = element("div", { class: "preview", "aria-live": "polite" });
      const add = (alike, label) => element("button", {
        type: "button", class: one.cause && alike == null ? "main" : "", "data-at": `add ${i} ${alike ?? ""}`, "aria-label": `Add ${label}`,
        onclick: () => act.do({ do: "add", suspect: i, alike }),
        onfocus: () => act.preview(i, alike, preview), onmouseenter: (event) => { event.stopPropagation(); act.preview(i, alike, preview); },
      }, alike == null ? "Add" : `Add ${label}`);
      const alike = one.alike.length ? element("div", { class: "alike" }, element("span", { class: "fine" }, "cannot be told apart from "), one.alike.map((label, k) => add(k, label))) : null;
      const figures = [element("dt", {}, "change"), element("dd", { class: one.later?.value > 0 ? "bad" : "" }, number(one.later)), element("dt", {}, "better in"), element("dd", {}, one.stretches), element("dt", {}, "p-value"), element("dd", {}, one.p)];
      return element("li", { class: one.cause ? "cause" : "", onmouseenter: () => act.preview(i, null, preview), onmouseleave: () => act.preview(null), onfocusout: () => act.preview(null) },
        element("div", { class: "head" }, element("strong", {}, one.label), UNPROVEN[one.standing] ? element("span", { class: "standing" }, UNPROVEN[one.standing]) : null, add(null, one.exactly)),
        one.parameters ? element("div", { class: "fine" }, one.parameters) : null,
        one.before && one.after ? element("div", {}, bar(one.after.value / Math.max(one.before.value, one.after.value), "error with it, of the error without"), " ", number(one.before), " → ", number(one.after)) : null,
        element("dl", {}, figures),
        one.cause ? element("p", { class: "fine" }, one.physics, " ", one.when) : null,
        one.cause && one.bench_check ? details("How to confirm", false, element("p", { class: "fine" }, one.bench_check)) : null,
        alike, preview);
    };
    const first = Math.min(causes, CARDS), others = judged.suspects.slice(causes);
    return [
      element("h2", {}, "What is missing?"),
      causes ? element("p", { class: "fine" }, "Rms error on later data of the model as it is, and fitted with each; the most helpful first.") : null,
      causes ? element("ol", { class: "suspects" }, judged.suspects.slice(0, first).map(item)) : element("p", { class: "fine" }, judged.calm ? "No suspect is worth adding." : "No suspect explains it by itself."),
      causes > first ? details(`${causes - first} more that are named`, false, element("ol", { class: "suspects" }, judged.suspects.slice(first, causes).map((one, i) => item(one, first + i)))) : null,
      others.length ? details(`${others.length} others that were tried`, false, element("ol", { class: "suspects" }, others.map((one, i) => item(one, causes + i)))) : null,
    ];
  }

  function beside(state, act, shown) {
    if (!state.fitted) return [];
    const curves = state.fitted.curves.filter((curve) => curve.name !== "temperature");
    return [details("Curves below", false, element("div", { class: "choices" }, curves.map((curve) => element("label", {}, element("input", { type: "checkbox", checked: shown.has(curve.name), "data-at": `curve ${curve.name}`, onchange: (event) => act.curve(curve.name, event.target.checked) }), ` ${curve.label}${curve.group === "contribution" ? " (contribution)" : ""}`))))];
  }

  // The error as it falls: first, now, the noise floor, and what the suspect under the pointer would leave.
  function summary(state, previewed) {
    const last = state.history[state.history.length - 1], rows = state.history.filter((row) => row.later && row.same === last.same), first = rows[0];
    const advised = state.advised ? element("p", { class: "fine", "data-at": "advised" }, state.advised) : null;
    if (!first) return [advised, element("p", { class: "soft" }, state.fitted ? "Measuring the error on later data…" : "")];
    const now = last?.later, longest = Math.max(first.later.value, now?.value || 0), floor = state.judged?.floor?.value;
    const said = ["Rms error on later data: "];
    if (last === first) said.push(element("strong", {}, number(first.later)));
    else said.push(number(first.later), " → ", element("strong", {}, number(now, "…")), " ", last.db ? element("strong", { class: last.db.value < 0 ? "good" : "bad" }, number(last.db)) : null);
    if (previewed) said.push(element("span", { class: "previewed" }, " → ", number(previewed), " with it"));
    const drawn = bar((now || first.later).value / longest, "error now, of the first", floor ? floor / longest : null);
    if (previewed) drawn.append(element("u", { width: `${100 * Math.min(previewed.value / longest, 1)}%` }));
    return [element("p", {}, said), element("div", { class: "fall" }, drawn, element("span", { class: "fine" }, floor ? "mark: noise floor" : "")), advised];
  }

  // The log as it is, before its columns have roles.
  function raw(state) {
    if (state.fitted || !state.raw?.length) return [];
    const picture = (curve) => {
      const known = curve.values.filter((v) => v != null), low = Math.min(...known), high = Math.max(...known), n = curve.values.length;
      let pen = "M";
      const path = (curve.values.map((v, i) => { if (v == null) { pen = "M"; return ""; } const at = `${pen}${(600 * i / Math.max(n - 1, 1)).toFixed(1)},${(58 - 56 * (v - low) / ((high - low) || 1)).toFixed(1)}`; pen = "L"; return at; }).join(""));
      const drawn = element("div");
      drawn.innerHTML = `<svg viewBox="0 0 600 60" preserveAspectRatio="none"><path d="${path}"/></svg>`; // numbers alone
      return element("figure", {}, element("figcaption", { class: "fine" }, `${curve.shown}${curve.unit ? ` [${curve.unit}]` : ""}: ${curve.low} to ${curve.high}`), drawn);
    };
    return [element("h2", {}, "The log as it is"), ...state.raw.map(picture)];
  }

  Object.assign(tc, { panels: { columns, model, history, verdict, where, suspects, beside, summary, raw } });
})();
