"use strict";
// Elements of the page. Names of columns and files are their writers': text is set as text, never as HTML.
(() => {
  const tc = (window.thermocorr ??= {});

  // element("button", { class: "x", onclick: run }, "text", other): attributes, listeners, children
  function element(tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
      else if (name === "width") made.style.width = value;
      else if (name in { value: 0, checked: 0, disabled: 0, selected: 0 }) made[name] = value;
      else if (value === true) made.setAttribute(name, "");
      else if (value !== false && value != null) made.setAttribute(name, value);
    }
    made.append(...children.flat().filter((child) => child != null && child !== false));
    return made;
  }

  // A number as the program says it, with all digits as an attribute for who reads the page by machine.
  function number(figure, otherwise = "–") {
    return figure ? element("data", { class: "n", value: figure.value }, figure.text) : element("span", { class: "soft" }, otherwise);
  }

  // Share 0..1 as a bar, with a mark where one belongs.
  function bar(share, label, mark = null) {
    const clipped = (v) => `${100 * Math.min(Math.max(v, 0), 1)}%`;
    const made = element("span", { class: "bar", role: "img", "aria-label": label });
    made.append(element("i", { width: clipped(share) }));
    if (mark != null) {
      const line = element("b");
      line.style.left = clipped(mark);
      made.append(line);
    }
    return made;
  }

  // A part of the page that is built anew only when what it shows has changed, and keeps the focus where it was.
  class Part {
    constructor(place, build) {
      this.place = place;
      this.build = build;
      this.shown = null;
    }
    show(content, whole = content) {
      const now = JSON.stringify(content);
      if (now === this.shown) return;
      this.shown = now;
      const held = this.place.contains(document.activeElement) ? document.activeElement.dataset.at : null;
      this.place.replaceChildren(...[this.build(whole)].flat().filter(Boolean));
      if (held) this.place.querySelector(`[data-at="${CSS.escape(held)}"]`)?.focus();
    }
  }

  // Let the browser save what was fetched.
  tc.saved = (name, blob) => {
    const link = element("a", { href: URL.createObjectURL(blob), download: name });
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  };

  Object.assign(tc, { element, number, bar, Part });
})();
