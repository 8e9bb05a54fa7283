// Panel of one episode: participants, events and state as text.

import { announce, end, kick, mute, pauseOrResume, spectatorLink } from "./actions.js";
import { download, follow, get } from "./api.js";
import { attempt, toast } from "./dialogs.js";
import { controllerWords, heading, phaseBadge, progress, recordingWords, updatePauseButton, stepWords } from "./episodes.js";
import { pageAddress, spectatorAddress } from "./links.js";
import live from "./replay/live.js";
import { nodeName } from "./nodes.js";
import { IN_NEW_TAB } from "./recordings.js";
import { Rows, button, bytes, h, icon, latency, setAttribute, setText } from "./dom.js";

const traffic = (row) => (row.received_bytes ? `${bytes(row.received_bytes)} in` : "");

function person(row, remove, silence) {
  let now = row;
  const name = h("b");
  const more = h("span", { class: "more" });
  const removeButton = button("away", "Remove", () => remove(now), "icon small");
  const muteButton = button("mute", "Mute", () => silence(now), "icon small");
  const root = h("li", { class: "person" }, h("i"), h("div", {}, name, more), muteButton, removeButton);
  return {
    root,
    update(next) {
      now = next;
      const seat = next.player != null;
      setAttribute(root, "data-who", seat ? next.controller || "free" : next.present ? "watching" : "absent");
      setText(name, next.name || next.player);
      const words = seat
        ? [next.name ? next.player : "", controllerWords(next), stepWords(next), next.rejected ? `${next.rejected} rejected` : ""]
        : [next.present ? "watching" : "away", next.kind];
      const facts = [...words, next.muted ? "muted" : "", latency(next), traffic(next), next.address].filter(Boolean).join(" · ");
      setText(more, seat && !next.name ? `· ${facts}` : facts);
      setAttribute(more, "title", `${bytes(next.recorded_bytes)} of chat and reasoning in the recording`);
      setAttribute(removeButton, "aria-label", `Remove ${next.name}`);
      setAttribute(muteButton, "aria-label", `Mute ${next.name}`);
      setAttribute(muteButton, "title", next.muted ? "Unmute" : "Mute");
      setAttribute(muteButton, "aria-pressed", String(next.muted));
      removeButton.hidden = muteButton.hidden = !next.session;
    },
  };
}

function emptyLog(row) {
  if (!row.recording) return "Events are read from the recording, but this episode is not recorded.";
  return row.node && row.phase !== "ended" ? "In a cluster, events are shown after the end." : "No events yet.";
}

function line(entry, number) {
  const reasons = entry.reasons.length ? h("em", {}, `: ${entry.reasons.join("; ")}`) : null;
  const root = h("li", { "data-kind": entry.kind, "data-number": number },
    h("span", { class: "step" }, entry.step),
    entry.who ? h("b", {}, entry.who) : null,
    h("span", {}, entry.text, reasons));
  return { root, update: () => {} };
}

export class Watch {
  constructor(root, opened, server) {
    this.root = root;
    this.opened = opened;
    this.server = server;
    this.stop = () => {};
    this.episode = "";
  }

  show(episode) {
    this.stop();
    this.live?.close();
    this.episode = episode;
    this.root.replaceChildren();
    this.root.hidden = !episode;
    this.opened(episode);
    if (!episode) return;
    this.build();
    this.stop = follow(`api/episodes/${encodeURIComponent(episode)}/events`, {
      received: (row) => this.update(row),
      linked: (up) => this.root.classList.toggle("stale", !up),
      gone: (problem) => {
        toast(problem.message, true);
        this.show("");
      },
    });
  }

  build() {
    this.row = null;
    this.heading = heading();
    this.phase = phaseBadge();
    this.progress = progress();
    this.people = h("ul", { class: "people" });
    this.peopleRows = new Rows(this.people, (row) => row.player ?? row.session, (row) => person(row, (who) => kick(this.row, who), (who) => mute(this.row, who)));
    this.log = h("ol", { class: "log", tabindex: "0", "aria-label": "Events" });
    this.logRows = new Rows(this.log, (entry) => entry.key, (entry) => line(entry, this.numberOf(entry.who)));
    this.text = h("pre", { class: "state", tabindex: "0" });
    this.kitchen = h("canvas", { class: "kitchen", role: "img", "aria-label": "Kitchen" });
    const path = `api/episodes/${encodeURIComponent(this.episode)}`;
    this.live = new live.LiveKitchen(this.kitchen, (what) => get(`${path}/${what}`));
    this.problem = h("p", { class: "problem" });
    this.node = h("p", { class: "about" });
    this.pauseButton = button("pause", "Pause", () => pauseOrResume(this.row));
    this.endButton = button("stop", "End", () => end(this.row), "danger");
    this.command = h("code");
    this.spectate = h("p", {}, h("span", {}, "In a browser, as a spectator"), button("eye", "Make a link", () => this.invite(), "small"));
    this.recording = h("span");
    this.save = h("a", { class: "button small", onclick: (event) => attempt(() => download(event)) }, icon("save"), h("span", {}, "Download"));
    this.replay = h("a", { class: "button small", ...IN_NEW_TAB }, icon("play"), h("span", {}, "Replay"));
    this.say = this.sayForm();
    this.root.append(h("div", { class: "scroll" },
      h("div", { class: "head" },
        h("div", { class: "chips" }, this.heading.code, this.phase.root,
          button("away", "Close", () => this.show(""), "icon close")),
        this.heading.title, this.heading.about, this.node, this.progress.root, this.problem,
        h("div", { class: "actions" }, this.pauseButton, this.endButton)),
      this.kitchen,
      h("h3", {}, "Seats and spectators"), this.people,
      h("h3", {}, "Events"), this.log, this.say,
      h("h3", {}, "Watch and record"),
      h("div", { class: "elsewhere" },
        this.spectate,
        h("p", {}, this.command, button("copy", "Copy the command", () => this.copy(this.command), "icon small")),
        h("p", {}, this.recording, this.replay, this.save)),
      h("h3", {}, "State as text"), this.text,
    ));
  }

  sayForm() {
    const input = h("input", { maxlength: 500, required: true, placeholder: "Announce to this episode", "aria-label": "Announce to this episode", autocomplete: "off" });
    return h("form", {
      class: "say",
      onsubmit: (event) => {
        event.preventDefault();
        announce(this.row, input.value.trim());
        input.value = "";
      },
    }, input, h("button", { class: "button", type: "submit" }, icon("say"), h("span", {}, "Announce")));
  }

  // Index of a participant's seat colour.
  numberOf(who) {
    const index = this.row.seats.findIndex((seat) => who && (seat.player === who || seat.name === who));
    return index < 0 ? null : String(index % 8);
  }

  update(row) {
    this.row = row;
    for (const part of [this.heading, this.phase, this.progress]) part.update(row);
    this.peopleRows.update([...row.seats, ...row.audience]);
    for (const seat of row.seats) setAttribute(this.peopleRows.rows.get(seat.player).root, "data-number", this.numberOf(seat.player));
    this.updateLog(row);
    setText(this.text, row.text);
    this.live.update(row);
    setText(this.node, row.node ? `on ${nodeName(row.node)}; other nodes' episodes are updated every second` : "");
    this.node.hidden = !row.node;
    setText(this.problem, row.problem);
    this.problem.hidden = !row.problem;
    setText(this.command, row.watch);
    const ended = row.phase === "ended";
    this.pauseButton.hidden = this.endButton.hidden = this.say.hidden = ended;
    this.spectate.hidden = ended;
    updatePauseButton(this.pauseButton, row);
    setText(this.recording, recordingWords({ ...row, problem: "" }));
    // In a cluster, there is no file before the end.
    this.save.hidden = !row.recording || (!ended && (!row.recording.size || Boolean(row.node)));
    this.replay.hidden = this.save.hidden;
    if (row.recording) {
      setAttribute(this.replay, "href", `replay#${encodeURIComponent(row.recording.name)}`);
      setAttribute(this.save, "href", `api/recordings/${row.recording.name}`);
      setAttribute(this.save, "download", row.recording.name);
    }
  }

  // The server sends the last lines each time. Lines have no id, so equal lines are numbered.
  updateLog(row) {
    const atEnd = this.log.scrollHeight - this.log.scrollTop - this.log.clientHeight < 24;
    const seen = new Map();
    this.logRows.update(row.lines.map((entry) => {
      const plain = JSON.stringify(entry);
      seen.set(plain, (seen.get(plain) ?? 0) + 1);
      return { ...entry, key: `${plain}${seen.get(plain)}` };
    }));
    this.log.dataset.empty = emptyLog(row);
    this.log.classList.toggle("empty", row.lines.length === 0);
    if (atEnd) this.log.scrollTop = this.log.scrollHeight;
  }

  // A new link each time: a removed spectator cannot come back with the same one.
  async invite() {
    if (!pageAddress(this.server())) return toast("This server shows no page for browsers.", true);
    // The panel may show another episode when the link arrives.
    const { spectate } = this;
    const made = await spectatorLink(this.row);
    if (!made) return;
    const address = h("code", {}, spectatorAddress(this.server(), made.link));
    spectate.replaceChildren(address,
      button("copy", "Copy the link", () => this.copy(address), "icon small"),
      h("a", { class: "button small", href: address.textContent, target: "_blank", rel: "noreferrer" }, icon("eye"), h("span", {}, "Open")));
    spectate.querySelector("a").focus();
  }

  async copy(element) {
    try {
      await navigator.clipboard.writeText(element.textContent);
      toast("Copied");
    } catch {
      getSelection().selectAllChildren(element);
    }
  }
}
