// The list of episodes.

import { isPausedByOperator, pauseOrResume } from "./actions.js";
import { nodeName } from "./nodes.js";
import { Rows, button, bytes, countdown, h, latency, number, setAttribute, setText, taskTitle } from "./dom.js";

const REASONS = {
  operator: "paused by the operator",
  absence: "waiting for an absent player",
  storage: "cannot be recorded",
  restart: "waiting after a restart",
  deserted: "everyone is away",
};

const OUTCOMES = { goal: "goal reached", step_limit: "step limit", abandoned: "abandoned", aborted: "ended" };

export function phaseBadge() {
  const root = h("span", { class: "phase" });
  return {
    root,
    update(row) {
      const state = row.problem ? "problem" : row.outcome?.reason === "goal" ? "goal" : row.phase;
      setAttribute(root, "data-phase", state);
      if (row.outcome) countdown(root, null, OUTCOMES[row.outcome.reason] ?? row.outcome.reason);
      else if (row.pause) countdown(root, row.pause.left, REASONS[row.pause.reason] ?? row.pause.reason);
      else countdown(root, null, row.phase);
    },
  };
}

export function heading() {
  const code = h("span", { class: "code" });
  const title = h("h2", { class: "task" });
  const about = h("p", { class: "about" });
  return {
    code, title, about,
    update(row) {
      const task = taskTitle(row.task);
      const clock = row.step_rate ? `${number(row.step_rate)} steps/s` : row.clock;
      setText(code, row.code);
      setText(title, task.title);
      setText(about, `${task.set} · ${clock}`);
    },
  };
}

export function progress() {
  const bar = h("progress", { max: 1, value: 0 });
  const words = h("span", { class: "steps" });
  return {
    root: h("div", { class: "progress" }, words, bar),
    update(row) {
      bar.max = row.max_steps;
      bar.value = row.step;
      setText(words, `step ${number(row.step)} of ${number(row.max_steps)}`);
    },
  };
}

// Number of a seat's steps by what happened in them.
export function stepWords(seat) {
  const counts = [["acted", seat.acted], ["busy", seat.busy], ["waiting", seat.waiting], ["idle", seat.idle],
    ["away", seat.away], ["substituted", seat.substituted]];
  const shown = counts.filter(([, steps]) => steps).map(([what, steps]) => `${number(steps)} ${what}`);
  return shown.length ? `steps: ${shown.join(", ")}` : "";
}

// Current controller of a seat.
export function controllerWords(seat) {
  if (seat.controller === "substitute") return seat.name ? `substitute for ${seat.name}` : "substitute";
  if (!seat.name) return "free";
  return seat.controller === "absent" || !seat.present ? "away" : seat.kind;
}

function seatChip() {
  const name = h("b");
  const more = h("span");
  const root = h("li", { class: "seat" }, h("i"), name, more);
  return {
    root,
    update(seat) {
      setAttribute(root, "data-who", seat.controller || "free");
      setAttribute(root, "title", [`${seat.player}: ${controllerWords(seat)}${seat.shown_as ? ` (shown as ${seat.shown_as})` : ""}`, stepWords(seat), `${seat.rejected} rejected`].filter(Boolean).join(" · "));
      setText(name, seat.name || seat.player);
      setText(more, [controllerWords(seat), latency(seat)].filter(Boolean).join(" · "));
    },
  };
}

function labelChip() {
  const name = h("span");
  const value = h("b");
  return {
    root: h("li", {}, name, value),
    update([key, text]) {
      setText(name, key);
      setText(value, text);
    },
  };
}

// The study's labels in a list.
export const labelRows = (list) => new Rows(list, ([name]) => name, labelChip);

function card(row, watch) {
  const parts = { heading: heading(), phase: phaseBadge(), progress: progress() };
  const seats = h("ul", { class: "seats" });
  const seatRows = new Rows(seats, (seat) => seat.player, seatChip);
  const traffic = h("span");
  const recording = h("span");
  const spectators = h("span");
  const node = h("span", { class: "node" });
  const labels = h("ul", { class: "labels" });
  const shownLabels = labelRows(labels);
  let now = row;
  const pauseButton = button("pause", "Pause", () => pauseOrResume(now));
  const watchButton = button("eye", "Watch", () => watch(now.episode), "primary");
  const root = h("article", { class: "episode", "data-code": row.code },
    h("div", { class: "what" }, h("div", { class: "chips" }, parts.heading.code, parts.phase.root), parts.heading.title, parts.heading.about, labels),
    parts.progress.root,
    seats,
    h("div", { class: "figures" }, traffic, spectators, recording, node),
    h("div", { class: "actions" }, pauseButton, watchButton),
  );
  return {
    root,
    update(next) {
      now = next;
      for (const part of Object.values(parts)) part.update(next);
      seatRows.update(next.seats);
      setText(traffic, `${number(next.rates.received)} in · ${number(next.rates.sent)} out msg/s`);
      setText(spectators, next.spectators ? `${next.spectators} watching` : "");
      setText(recording, recordingWords(next));
      setText(node, next.node ? `on ${nodeName(next.node)}` : "");
      shownLabels.update(Object.entries(next.labels));
      setAttribute(recording, "class", next.problem ? "bad" : "");
      pauseButton.hidden = next.phase === "ended";
      updatePauseButton(pauseButton, next);
    },
  };
}

export function updatePauseButton(element, row) {
  const held = isPausedByOperator(row);
  element.querySelector("use").setAttribute("href", held ? "#i-play" : "#i-pause");
  setText(element.querySelector("span"), held ? "Resume" : "Pause");
}

export function recordingWords(row) {
  if (row.problem) return row.problem;
  if (!row.recording) return "not recorded";
  if (row.phase === "ended") return "recorded";
  return row.recording.size ? `recording, ${bytes(row.recording.size)}` : "recording is empty";
}

export class Episodes {
  constructor(root, watch) {
    this.empty = h("p", { class: "empty" });
    const list = h("div", { class: "list" });
    root.append(list, this.empty);
    this.rows = new Rows(list, (row) => row.episode, (row) => card(row, watch));
  }

  update({ episodes }, filtered) {
    this.rows.update(episodes);
    this.empty.hidden = episodes.length > 0;
    setText(this.empty, filtered ? "No episode matches." : "No episodes yet.");
  }

  mark(episode) {
    for (const [key, row] of this.rows.rows) row.root.classList.toggle("chosen", key === episode);
  }
}
