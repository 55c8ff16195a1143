"use strict";
// The lists at the sides: columns, model, history; verdict, suspects, places. Each is a function of the state.
(() => {
  const tc = (window.thermocorr ??= {});
  const { element, number, bar } = tc;
  const CARDS = 3; // causes that are shown unfolded
  const UNPROVEN = { confirmed: "", helps: "helps; cause not proven", proven: "proven, not confirmed" };
  const ROLES = { suspect: "suspect", temperature: "temperature", reading: "reading", reference: "reference", time: "time", run: "run", ignored: "ignore" };

  const details = (summary, open, ...children) => element("details", { open }, element("summary", {}, summary), ...children);
  const named = (column) => (column.unit && !column.shown.includes(column.unit) ? `${column.shown} [${column.unit}]` : column.shown);
  // Suspects and places of failure have one look.
  const card = (kind, ...children) => element("li", { class: `card ${kind}` }, ...children);

  function question(state, act) { // which column is the temperature, which the reading: one button for each
    const asked = ["temperature", "reading"].filter((role) => !state.columns.some((column) => column.role === role));
    const role = asked[0] ?? "reading", other = asked.length ? null : "temperature";
    const given = Object.fromEntries(state.columns.filter((column) => ["temperature", "reading", "run"].includes(column.role)).map((column) => [column.role, column.name]));
    const take = (name) => {
      const roles = { ...given, [role]: name };
      if (roles.temperature && roles.reading) act.do({ do: "assign", ...roles }); else act.half(role, name);
    };
    const may = state.columns.filter((column) => column.kind === "number" && (column.role === "suspect" || column.role === role));
    return element("div", { class: "question" }, element("p", {}, `Which column is the ${role}?`, other ? element("span", { class: "soft" }, ` The temperature is ${given.temperature}.`) : null),
      element("div", { class: "tools" }, may.map((column) => element("button", { type: "button", "data-at": `ask ${role} ${column.name}`, onclick: () => take(column.name) }, named(column)))));
  }

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
      return element("tr", {}, element("th", { scope: "row" }, named(column), missing), element("td", {}, select));
    })));
    const refused = element("p", { class: "refused", role: "alert", "data-at": "refused" });
    const apply = () => {
      refused.textContent = "";
      const of = (role) => [...selects].filter(([, select]) => select.value === role).map(([name]) => name);
      for (const role of ["temperature", "reading", "reference", "time", "run"]) {
        if (of(role).length > 1) { refused.textContent = `Several columns are to be the ${role}: ${of(role).join(", ")}. Only one can.`; return; }
      }
      const temperature = of("temperature")[0] ?? (of("reference").length ? of("reading")[0] : undefined); // a thermometer that heats itself
      if (!temperature || !of("reading").length) { refused.textContent = "Say which column is the temperature and which the reading."; return; }
      act.do({ do: "assign", temperature, reading: of("reading")[0], reference: of("reference")[0] ?? null, time: of("time")[0] ?? null, run: of("run")[0] ?? null, ignored: of("ignored") }, (text) => { refused.textContent = text; });
    };
    const list = [table, element("button", { type: "button", "data-at": "columns", onclick: apply }, "Apply"), refused];
    return [
      element("h2", {}, "Columns"),
      state.decided ? null : question(state, act),
      ...(state.decided ? list : [details("All columns", false, ...list)]),
      state.fitted?.without_times ? element("p", { class: "fine" }, "No column of times is set: rows count as 1 s apart. Set it above, or give the command --sampling-period.") : null,
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

  function history(state, act, versus) {
    const rows = state.history;
    const list = element("ol", { class: "steps" }, rows.map((row) => {
      const buttons = element("span", { class: "acts" }), last = row.step === rows.length;
      if (!last) buttons.append(element("button", { type: "button", class: "plain", "data-at": `compare ${row.step}`, "aria-pressed": String(versus === row.step - 1), onclick: () => act.compare(row.step - 1) }, "compare"));
      if (row.kind !== "roles") buttons.append(element("button", { type: "button", class: "plain", "data-at": `drop ${row.step}`, "aria-label": `remove step ${row.step}: ${row.text}`, onclick: () => act.do({ do: "drop", step: row.step - 1 }) }, "remove"));
      return element("li", { "aria-current": last ? "step" : false },
        element("div", { class: "what" }, row.text, " ", buttons),
        element("div", { class: "error" }, row.same ? number(row.later, "…") : element("span", { class: "soft" }, "fitted to other readings: not compared"), " ", row.db ? element("strong", { class: row.db.value < 0 ? "good" : "bad" }, number(row.db)) : null),
        element("div", { class: "fine" }, "held out ", number(row.held_out), ", in sample ", number(row.rms)),
      );
    }));
    return [
      element("h2", {}, "Steps"),
      rows.length ? list : element("p", { class: "fine" }, "None yet."),
      state.fitted?.left_out ? element("p", { class: "fine" }, `${state.fitted.left_out}: grey in the picture.`) : null,
      element("div", { class: "tools" },
        element("button", { type: "button", "data-at": "undo", disabled: !state.can_undo, "aria-keyshortcuts": "Control+Z", onclick: () => act.do({ do: "undo" }) }, "Undo"),
        element("button", { type: "button", "data-at": "redo", disabled: !state.can_redo, "aria-keyshortcuts": "Control+Y", onclick: () => act.do({ do: "redo" }) }, "Redo")),
    ];
  }

  function verdict(state, act, doing) {
    const { judged, lacking, fitted } = state;
    const head = element("h2", { tabindex: -1, "data-at": "verdict" }, "Is anything missing?");
    const notes = fitted?.notes.length ? details(`${fitted.notes.length} ${fitted.notes.length === 1 ? "note" : "notes"} on the fit`, false, element("ul", {}, fitted.notes.map((note) => element("li", {}, note)))) : null;
    const again = element("button", { type: "button", "data-at": "judge", onclick: () => act.do({ do: "judge" }) }, "Judge again");
    if (!fitted) return [head, element("p", { class: "soft" }, "There is no model yet.")];
    if (!judged) return [head, element("p", { class: "soft" }, lacking || (doing ? `${doing}…` : "Looking…")), lacking ? again : null, notes];
    return [
      head,
      element("p", {}, element("strong", { class: "verdict", "data-verdict": judged.verdict, "data-calm": judged.calm }, judged.verdict), " ", judged.said),
      element("p", { class: "figures" }, "Residual ", number(judged.rms), ", noise floor ", number(judged.floor), `: ${judged.explainable} of its variance could still be explained.`),
      judged.left.length ? element("p", { class: "fine" }, judged.left.join(" ")) : null,
      notes,
    ];
  }

  function where(state, act) {
    const places = state.fitted?.where ?? [];
    if (!state.fitted || (!places.length && !state.judged)) return [];
    if (!places.length) return [element("h2", {}, "Where does it fail?"), element("p", { class: "fine" }, "Nowhere beyond the noise.")];
    const longest = Math.max(...places.map((place) => place.share.value), 1e-300);
    const item = (place, i) => {
      const text = `${place.aspect}: ${place.interval}`, can = place.from_to || place.column != null;
      return card("", element("div", { class: "head" }, element("strong", {}, text), can ? element("button", { type: "button", "data-at": `place ${i}`, "aria-label": `show where ${text}`, onclick: () => act.go(place) }, "Show") : null),
        element("div", {}, bar(place.share.value / longest, "share of the error", place.rows.value / longest), " ", element("span", { class: "fine" }, number(place.share), " of the error, in ", number(place.rows), " of the rows")));
    };
    return [
      element("h2", {}, "Where does it fail?"),
      element("p", { class: "fine" }, "Share of the error beyond the noise; the mark is the share of the rows."),
      element("ul", { class: "cards places" }, places.slice(0, 4).map(item)),
      places.length > 4 ? details(`${places.length - 4} more places`, false, element("ul", { class: "cards places" }, places.slice(4).map((place, i) => item(place, 4 + i)))) : null,
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
        onclick: () => act.add(i, alike),
        onfocus: () => act.preview(i, alike, preview), onmouseenter: (event) => { event.stopPropagation(); act.preview(i, alike, preview); },
      }, alike == null ? "Add" : `Add ${label}`);
      const alike = one.alike.length ? element("div", { class: "alike" }, element("span", { class: "fine" }, "cannot be distinguished from "), one.alike.map((label, k) => add(k, label))) : null;
      const figures = [element("dt", {}, "of averages"), element("dd", { class: one.later?.value > 0 ? "bad" : "" }, number(one.later)), element("dt", {}, "better in"), element("dd", {}, one.stretches), element("dt", {}, "p-value"), element("dd", {}, one.p)];
      const made = card(one.cause ? "cause" : "",
        element("div", { class: "head" }, element("strong", {}, one.label), UNPROVEN[one.standing] ? element("span", { class: "standing" }, UNPROVEN[one.standing]) : null, add(null, one.exactly)),
        one.parameters ? element("div", { class: "fine" }, one.parameters) : null,
        one.before && one.after ? element("div", {}, bar(one.after.value / Math.max(one.before.value, one.after.value), "error with it, of the error without"), " ", number(one.before), " → ", number(one.after)) : null,
        element("dl", {}, figures),
        one.cause ? element("p", { class: "fine" }, one.physics, " ", one.when) : null,
        one.cause && one.bench_check ? details("How to confirm", false, element("p", { class: "fine" }, one.bench_check)) : null,
        alike, preview);
      made.addEventListener("mouseenter", () => act.preview(i, null, preview));
      made.addEventListener("mouseleave", () => act.preview(null));
      made.addEventListener("focusout", () => act.preview(null));
      return made;
    };
    const first = Math.min(causes, CARDS), others = judged.suspects.slice(causes);
    const listed = (some, from) => element("ol", { class: "cards suspects" }, some.map((one, k) => item(one, from + k)));
    return [
      element("h2", {}, "What is missing?"),
      causes ? element("p", { class: "fine" }, "Rms error on later data of the model as it is, and fitted with each; the most helpful first.") : null,
      causes ? listed(judged.suspects.slice(0, first), 0) : element("p", { class: "fine" }, judged.calm ? "No suspect is worth adding." : "No suspect explains it by itself."),
      causes > first ? details(`${causes - first} more causes`, false, listed(judged.suspects.slice(first, causes), first)) : null,
      others.length ? details(`${others.length} others that were tried`, false, listed(others, causes)) : null,
    ];
  }

  function below(state, act, shown) {
    if (!state.fitted) return [];
    return [details("Columns below", false, element("div", { class: "choices" }, Object.entries(state.fitted.below).map(([name, text]) => element("label", {}, element("input", { type: "checkbox", checked: shown.includes(name), "data-at": `below ${name}`, onchange: (event) => act.below(name, event.target.checked) }), ` ${text}`))))];
  }

  // The error as it falls, in words; the bars are a picture.
  function summary(state, previewed) {
    const rows = state.errors.filter((row) => row.error), now = state.errors[state.errors.length - 1];
    const advised = state.advised ? element("p", { class: "fine", "data-at": "advised" }, state.advised) : null;
    if (!rows.length) return [element("p", { class: "soft" }, state.fitted ? "Measuring the error on later data…" : "")];
    const said = ["Rms error on later data: ", rows.length > 1 ? [number(rows[0].error), " → "] : null, element("strong", {}, number(now.error, "…"))].flat();
    if (previewed) said.push(element("span", { class: "previewed" }, " → ", number(previewed), " with it"));
    return [element("p", { class: "falls" }, ...said), advised];
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
      return element("figure", {}, element("figcaption", { class: "fine" }, `${named(curve)}: ${curve.low} to ${curve.high}`), drawn);
    };
    return [element("h2", {}, "The log as it is"), ...state.raw.map(picture)];
  }

  Object.assign(tc, { panels: { columns, model, history, verdict, where, suspects, below, summary, raw } });
})();
