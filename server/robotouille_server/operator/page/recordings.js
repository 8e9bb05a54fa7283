// The list of recordings.

import { download } from "./api.js";
import { attempt } from "./dialogs.js";
import { labelRows } from "./episodes.js";
import { nodeName } from "./nodes.js";
import { Rows, bytes, h, icon, number, setAttribute, setText, taskTitle } from "./dom.js";

const WORDS = {
  goal: "goal reached", step_limit: "step limit", abandoned: "abandoned", aborted: "ended",
  live: "being written", unfinished: "unfinished", unreadable: "unreadable", unread: "not read (large)",
};

const MAX_ARCHIVED = 500;
// The new tab gets a copy of the token.
export const IN_NEW_TAB = { target: "_blank", rel: "opener" };

function when(created) {
  const parts = created.match(/^(\d{4})-?(\d\d)-?(\d\d)T(\d\d):?(\d\d):?(\d\d)/);
  if (!parts) return created;
  const [year, month, day, hour, minute, second] = parts.slice(1).map(Number);
  const time = new Date(Date.UTC(year, month - 1, day, hour, minute, second));
  return time.toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}

function recording(row, checked, ticked) {
  const code = h("span", { class: "code" });
  const title = h("b");
  const name = h("span", { class: "name" });
  const players = h("span", { class: "name" });
  const labels = h("ul", { class: "labels" });
  const shownLabels = labelRows(labels);
  const outcome = h("span", { class: "phase" });
  const figures = h("span", { class: "figures" });
  const tick = h("input", { type: "checkbox", checked, onchange: (event) => ticked(row.name, event.target.checked) });
  const save = h("a", {
    class: "button", href: `api/recordings/${row.name}`, download: row.name,
    onclick: (event) => attempt(() => download(event)),
  }, icon("save"), h("span", {}, "Download"));
  const replay = h("a", { class: "button", href: `replay#${encodeURIComponent(row.name)}`, ...IN_NEW_TAB }, icon("play"), h("span", {}, "Replay"));
  return {
    root: h("article", { class: "recording" }, tick, h("div", {}, h("div", { class: "chips" }, code, title), name, players, labels), outcome, figures, h("div", { class: "actions" }, replay, save)),
    update(next) {
      const task = taskTitle(next.task || next.name);
      setText(code, next.code);
      code.hidden = !next.code;
      setText(title, task.title);
      const node = next.node && `on ${nodeName(next.node)}`;
      setText(name, [when(next.created), task.set, node].filter(Boolean).join(" · "));
      setText(players, next.players.join(", "));
      shownLabels.update(Object.entries(next.labels));
      setAttribute(title, "title", next.name);
      setAttribute(tick, "aria-label", `Select ${next.name}`);
      setText(outcome, WORDS[next.outcome] ?? next.outcome);
      setAttribute(outcome, "data-phase", { live: "running", goal: "goal", unreadable: "problem" }[next.outcome] ?? "ended");
      setText(figures, [next.steps == null ? "" : `${number(next.steps)} steps`, bytes(next.size)].filter(Boolean).join(" · "));
    },
  };
}

export class Recordings {
  constructor(root) {
    this.empty = h("p", { class: "empty" });
    const list = h("div", { class: "list" });
    this.ticked = new Set();
    this.words = h("span", {});
    this.archive = h("a", {
      class: "button", download: "recordings.tar", onclick: (event) => attempt(() => download(event)),
    }, icon("save"), h("span"));
    this.clear = h("button", { class: "button", type: "button", onclick: () => this.untick(list) }, "Clear selection");
    this.bar = h("div", { class: "archive" }, this.words, this.clear, this.archive);
    root.append(this.bar, list, this.empty);
    this.rows = new Rows(list, (row) => row.name, (row) => recording(row, this.ticked.has(row.name), (name, on) => this.tick(name, on)));
  }

  tick(name, on) {
    if (on) this.ticked.add(name);
    else this.ticked.delete(name);
    this.updateArchive();
  }

  // Ticks stay while other pages of the list are shown.
  untick(list) {
    this.ticked.clear();
    for (const tick of list.querySelectorAll("input")) tick.checked = false;
    this.updateArchive();
  }

  // One file with the ticked recordings, or with all that match the search.
  updateArchive() {
    const count = this.ticked.size || this.found;
    const query = new URLSearchParams(this.ticked.size ? [...this.ticked].map((name) => ["name", name]) : { search: this.search });
    this.bar.hidden = this.found < 2 && !this.ticked.size;
    this.clear.hidden = !this.ticked.size;
    this.archive.hidden = count > MAX_ARCHIVED;
    const recordings = count === 1 ? "recording" : "recordings";
    const elsewhere = [...this.ticked].filter((name) => !this.rows.rows.has(name)).length;
    setText(this.words, count > MAX_ARCHIVED
      ? `An archive holds ${MAX_ARCHIVED} recordings. Search for fewer, or select some.`
      : elsewhere ? `${number(elsewhere)} selected on other pages` : "");
    setText(this.archive.querySelector("span"), `Download ${this.ticked.size ? number(count) : `all ${number(count)}`} ${recordings}`);
    setAttribute(this.archive, "href", `api/archive?${query}`);
  }

  update({ recordings, found }, search) {
    Object.assign(this, { found, search });
    this.rows.update(recordings);
    this.updateArchive();
    this.empty.hidden = recordings.length > 0;
    setText(this.empty, search ? "No recording matches." : "No recordings yet.");
  }

  fail(problem) {
    this.rows.update([]);
    this.bar.hidden = true;
    this.empty.hidden = false;
    setText(this.empty, problem.message);
  }
}
