// Elements from plain values. Names and chat come from strangers, so text is never markup.

export function h(tag, props = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child != null));
  return element;
}

function svg(tag, attributes, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

export function icon(name) {
  return svg("svg", { "aria-hidden": "true" }, svg("use", { href: `#i-${name}` }));
}

export function button(symbol, label, onclick, more = "") {
  const words = h("span", {}, label);
  const element = h("button", { class: `button ${more}`, onclick, type: "button" }, icon(symbol), words);
  if (more.includes("icon")) {
    words.remove();
    element.title = label;
    element.setAttribute("aria-label", label);
  }
  return element;
}

export function setText(element, text) {
  const words = String(text);
  if (element.textContent !== words) element.textContent = words;
}

export function setAttribute(element, name, value) {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

// Save a blob as a file of the browser.
export function saveAs(blob, name) {
  const link = h("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

// Line chart without axes, scaled to its highest value.
export function sparkline() {
  const line = svg("polyline", {});
  const shape = { viewBox: "0 0 59 20", preserveAspectRatio: "none" };
  return {
    root: svg("svg", { class: "spark", "aria-hidden": "true", ...shape }, line),
    update(values) {
      const highest = Math.max(...values, 1e-9);
      const offset = 60 - values.length;
      const points = values.map((value, i) => `${offset + i},${19 - (18 * value) / highest}`);
      line.setAttribute("points", points.join(" "));
    },
  };
}

// List that keeps the element of each key, so that focus and scroll position survive updates.
export class Rows {
  constructor(parent, keyOf, make) {
    this.parent = parent;
    this.keyOf = keyOf;
    this.make = make;
    this.rows = new Map();
  }

  update(items) {
    const kept = new Map();
    let place = this.parent.firstChild;
    for (const item of items) {
      const key = this.keyOf(item);
      const row = this.rows.get(key) ?? this.make(item);
      row.update(item);
      if (row.root === place) place = place.nextSibling;
      else this.parent.insertBefore(row.root, place);
      kept.set(key, row);
    }
    for (const [key, row] of this.rows) if (!kept.has(key)) row.root.remove();
    this.rows = kept;
  }
}

// Numbers and times

export function bytes(count) {
  if (count == null) return "–";
  if (count < 1000) return `${Math.round(count)} B`;
  const units = ["kB", "MB", "GB"];
  let unit = -1;
  do {
    count /= 1000;
    unit += 1;
  } while (count >= 999.5 && unit < units.length - 1);
  return `${count < 10 ? count.toFixed(1) : Math.round(count)} ${units[unit]}`;
}

export function number(value) {
  if (value == null) return "–";
  return value.toLocaleString("en", { maximumFractionDigits: value < 10 ? 1 : 0 });
}

export function span(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  const hours = Math.floor(whole / 3600);
  return hours < 48 ? `${hours} h ${Math.floor((whole % 3600) / 60)} min` : `${Math.floor(hours / 24)} days`;
}

export function latency(row) {
  return row.latency_ms == null ? "" : `${number(row.latency_ms)} ms`;
}

export function taskTitle(task) {
  const [set, name] = task.includes("/") ? task.split(/\/(.*)/s) : ["", task];
  const words = name.replace(/^\d+_/, "").replaceAll("_", " ");
  return { title: words.charAt(0).toUpperCase() + words.slice(1), set: `${set} ${name.match(/^\d+/) ?? ""}`.trim() };
}

// Countdown that continues between two updates from the server.
export function countdown(element, left, words) {
  if (left == null) {
    delete element.dataset.until;
    setText(element, words);
    return;
  }
  element.dataset.until = performance.now() + left * 1000;
  element.dataset.words = words;
  tick(element);
}

function tick(element) {
  const left = (Number(element.dataset.until) - performance.now()) / 1000;
  setText(element, `${element.dataset.words} · ${span(Math.ceil(Math.max(0, left)))}`);
}

setInterval(() => document.querySelectorAll("[data-until]").forEach(tick), 250);
