// The list of recordings.

import { download } from "./api.js";
import { Rows, bytes, h, icon, number, setAttribute, setText, taskTitle } from "./dom.js";

const WORDS = {
  goal: "goal reached", step_limit: "step limit", abandoned: "abandoned", aborted: "ended",
  live: "being written", unfinished: "unfinished", unreadable: "unreadable", unread: "not read (large)",
};

function when(created) {
  const parts = created.match(/^(\d{4})-?(\d\d)-?(\d\d)T(\d\d):?(\d\d):?(\d\d)/);
  if (!parts) return created;
  const [year, month, day, hour, minute, second] = parts.slice(1).map(Number);
  const time = new Date(Date.UTC(year, month - 1, day, hour, minute, second));
  return time.toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
}

function recording(row) {
  const title = h("b");
  const name = h("span", { class: "name" });
  const outcome = h("span", { class: "phase" });
  const figures = h("span", { class: "figures" });
  const save = h("a", {
    class: "button", href: `api/recordings/${row.name}`, download: row.name,
    onclick: (event) => download(event, row.name),
  }, icon("save"), h("span", {}, "Download"));
  return {
    root: h("article", { class: "recording" }, h("div", {}, title, name), outcome, figures, save),
    update(next) {
      const task = taskTitle(next.task || next.name);
      setText(title, task.title);
      setText(name, [when(next.created), task.set].filter(Boolean).join(" · "));
      setAttribute(title, "title", next.name);
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
    root.append(list, this.empty);
    this.rows = new Rows(list, (row) => row.name, recording);
  }

  update({ recordings }, filtered) {
    this.rows.update(recordings);
    this.empty.hidden = recordings.length > 0;
    setText(this.empty, filtered ? "No recording matches." : "No recordings yet.");
  }

  fail(problem) {
    this.rows.update([]);
    this.empty.hidden = false;
    setText(this.empty, problem.message);
  }
}
