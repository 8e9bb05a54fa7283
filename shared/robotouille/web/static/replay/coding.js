// Labels of a codebook on moments and spans, by one coder, saved as a file.

import { element, setText } from "../play/dom.js";
import { clock, text } from "../play/texts.js";

/** @typedef {{id: string, title: string, key: string}} Label */
/** @typedef {{label: string, first: number, last: number}} Annotation */

const FORMAT = 1;
/** Colours of the labels on the timeline, in the order of the codebook. */
const COLOURS = ["#ffc454", "#68bbf5", "#94f0a0", "#f48478", "#c496f0", "#4ab2b2", "#f0ece4"];

export class Coding {
  /**
   * @param {Label[]} labels @param {import("./words.js").Words} words
   * @param {{step: () => number, go: (step: number) => void, changed: () => void}} page
   */
  constructor(labels, { reel }, page) {
    this.labels = labels;
    this.reel = reel;
    this.page = page;
    /** @type {Annotation[]} */
    this.made = [];
    /** @type {Map<string, number>} First steps of spans that have no end yet. */
    this.begun = new Map();
    this.saved = true;
    this.coder = element("input", { id: "coder", maxLength: 80, autocomplete: "off" });
    this.buttons = labels.map((label) => element(
      "button", { type: "button", onclick: (/** @type {MouseEvent} */ event) =>
        this.set(label, event.shiftKey) },
      element("kbd", {}, label.key), " ", label.title,
    ));
    this.list = element("ol", { class: "lines" });
    this.status = element("p", { class: "faint", role: "status" });
    const save = element("button", { type: "button", class: "main", onclick: () => this.save() },
      text("save"));
    this.root = element(
      "section", { class: "coding" }, element("h2", {}, text("labels")),
      element("p", { class: "faint" }, text("labelKeys")),
      element("div", { class: "labels" }, ...this.buttons), this.status, this.list,
      element("label", {}, text("coder"), " ", this.coder), save,
    );
    addEventListener("beforeunload", (event) => {
      if (!this.saved) event.preventDefault();
    });
  }

  /**
   * Set a label by its key. Return whether there is one.
   * @param {string} key @param {boolean} span
   */
  press(key, span) {
    const label = this.labels.find((each) => each.key === key.toLowerCase());
    if (label) this.set(label, span);
    return Boolean(label);
  }

  /**
   * Set a label on this step, or begin or end its span.
   * @param {Label} label @param {boolean} span
   */
  set({ id }, span) {
    const step = this.page.step();
    const from = this.begun.get(id);
    if (from !== undefined) {
      this.begun.delete(id);
      this.made.push({ label: id, first: Math.min(from, step), last: Math.max(from, step) });
    } else if (span) {
      this.begun.set(id, step);
    } else {
      this.made.push({ label: id, first: step, last: step });
    }
    this.show();
  }

  show() {
    this.saved = false;
    this.made.sort((a, b) => a.first - b.first || a.last - b.last);
    this.list.replaceChildren(...this.made.map((each) => {
      const { first, last, label } = each;
      const title = this.labels.find(({ id }) => id === label)?.title ?? label;
      const steps = first === last ? `${first}` : `${first}–${last}`;
      const go = element(
        "button", { type: "button", class: "line said", onclick: () => this.page.go(first) },
        element("span", { class: "when" }, clock(this.reel.times[first] / 1000)),
        element("span", {}, `${steps}: ${title}`),
      );
      const remove = element("button", { type: "button", class: "line remove", onclick: () => {
        this.made.splice(this.made.indexOf(each), 1);
        this.show();
      } }, "×");
      remove.setAttribute("aria-label", text("remove"));
      return element("li", {}, go, remove);
    }));
    this.buttons.forEach((button, place) =>
      button.setAttribute("aria-pressed", String(this.begun.has(this.labels[place].id))));
    setText(this.status, this.begun.size ? text("spanOpen") : "");
    this.page.changed();
  }

  /** Spans to draw: first and last step, row and colour. */
  get spans() {
    return this.made.map(({ label, first, last }) => {
      const row = this.labels.findIndex(({ id }) => id === label);
      return { first, last, row, colour: COLOURS[row % COLOURS.length] };
    });
  }

  save() {
    const coder = this.coder.value.trim();
    if (!coder) {
      setText(this.status, text("coderMissing"));
      this.coder.focus();
      return;
    }
    const { raw, last, task } = this.reel;
    const saved = {
      format: FORMAT, coder, recording: raw.digest, task: task.name, steps: last,
      labels: this.labels.map(({ id }) => id), annotations: this.made,
    };
    const content = new Blob([JSON.stringify(saved, null, 1)], { type: "application/json" });
    const link = element("a", {
      href: URL.createObjectURL(content),
      download: `labels_${coder.replace(/[^\p{L}\p{N}-]+/gu, "_")}_${raw.digest.slice(0, 8)}.json`,
    });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    this.saved = true;
  }
}
