// Figures of the server, problems and warnings.

import { nodeName } from "./nodes.js";
import { Rows, bytes, h, icon, number, setAttribute, setText, span, sparkline } from "./dom.js";

function card(label, withLine = false) {
  const value = h("strong");
  const note = h("span", { class: "note" });
  const line = withLine ? sparkline() : null;
  const root = h("div", { class: "card" }, h("span", { class: "label" }, label), value, note, line?.root);
  return { root, value, note, line };
}

function within(bound) {
  if (bound == null) return "–";
  return bound < 1000 ? `≤ ${number(bound)} ms` : `≤ ${number(bound / 1000)} s`;
}

const others = (fault) => (fault.episodes > 1 ? ` and ${number(fault.episodes - 1)} more` : "");

export class Totals {
  constructor(root, faults, alerts, watch) {
    this.cards = {
      episodes: card("Running"),
      connections: card("Connections"),
      steps: card("Steps per second", true),
      sent: card("Sent per second", true),
      late: card("Step lateness, 99 %"),
    };
    root.append(...Object.values(this.cards).map((one) => one.root));
    this.faults = new Rows(faults, (fault) => fault.node + fault.episode + fault.text, (fault) => {
      const words = h("span");
      const see = fault.episode
        ? h("button", { class: "button", onclick: () => watch(fault.episode) }, "Show")
        : null;
      return {
        root: h("p", {}, icon("warn"), words, see),
        update: (now) => setText(words, [now.node && nodeName(now.node), now.code && `${now.code}${others(now)}`, now.text].filter(Boolean).join(": ")),
      };
    });
    this.alerts = new Rows(alerts, (alert) => alert.node + alert.kind, () => {
      const words = h("span");
      const row = h("p", {}, icon("warn"), words);
      return {
        root: row,
        update: (now) => {
          setAttribute(row, "data-severity", now.severity);
          const text = now.text.charAt(0).toUpperCase() + now.text.slice(1);
          setText(words, now.node ? `${nodeName(now.node)}: ${text}` : text);
        },
      };
    });
  }

  update({ server, totals, faults, alerts }) {
    const { episodes, connections, steps, sent, late } = this.cards;
    const counts = totals.episodes;
    const state = server.draining ? " · draining: no new clients, running episodes may still end" : "";
    setText(document.getElementById("server"), `${server.url} · version ${server.version} · up ${span(server.uptime)}${state}`);
    setText(episodes.value, number(counts.running));
    setText(episodes.note, `${counts.paused} paused · ${counts.waiting} waiting · ${counts.ended} ended`);
    setText(connections.value, number(totals.connections));
    setText(connections.note, [`${number(totals.received_per_second)} messages/s in`, ...troubles(totals)].join(" · "));
    setAttribute(connections.root, "title", details(totals));
    setText(steps.value, number(totals.steps_per_second));
    setText(sent.value, bytes(totals.sent_bytes_per_second));
    setText(late.value, within(totals.lateness.p99));
    setText(late.note, `median ${within(totals.lateness.p50)} · 99.9 % ${within(totals.lateness.p999)}`);
    steps.line.update(totals.history.steps);
    sent.line.update(totals.history.bytes);
    this.faults.update(faults);
    this.alerts.update(alerts);
  }
}

const sum = (counts) => Object.values(counts).reduce((all, count) => all + count, 0);

// Errors and dropped connections since the start.
function troubles({ errors, dropped }) {
  return [[sum(errors), "errors"], [sum(dropped), "dropped"]]
    .filter(([count]) => count > 0)
    .map(([count, word]) => `${number(count)} ${word}`);
}

function details({ errors, dropped }) {
  const lines = (what, counts) => Object.entries(counts).map(([name, count]) => `${what} ${name}: ${count}`);
  return [...lines("error", errors), ...lines("dropped,", dropped)].join("\n");
}
