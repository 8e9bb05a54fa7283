// The timeline: a lane for each seat, marks for events, the steps to go, and the playhead.

import { seatMark } from "../play/panel.js";
import { element, setText } from "../play/dom.js";
import { clock, text } from "../play/texts.js";

/** @typedef {import("./player.js").Player} Player */
/** @typedef {import("./words.js").Words} Words */
/** @typedef {CanvasRenderingContext2D} Context */

/** Colour and height of each activity: either one tells them apart. */
/** @type {Map<string, [string, number]>} */
export const ACTIVITIES = new Map([
  ["a", ["#94f0a0", 1]], ["b", ["#5462f0", 0.72]], ["s", ["#b492e8", 0.72]],
  ["w", ["#c86a38", 0.46]], ["i", ["#aca8b2", 0.2]], ["x", ["#544e5c", 0.1]],
]);
const [TRACK, PAPER, ACCENT, BAD, GOOD, THOUGHT] =
  ["#342f3a", "#fffaf0", "#ffc454", "#f48478", "#7ec96e", "#c496f0"];
/** Shape and colour of the mark of each kind of event. */
/** @type {Map<string, [string, string]>} */
export const MARKS = new Map([
  ["said", ["circle", PAPER]], ["rejected", ["triangle", BAD]], ["lost", ["triangle", BAD]],
  ["thought", ["diamond", THOUGHT]], ["noted", ["diamond", THOUGHT]],
  ["announced", ["diamond", ACCENT]], ["paused", ["bars", ACCENT]],
  ["restarted", ["ring", ACCENT]], ["ended", ["flag", GOOD]],
]);
// Heights in CSS pixels: marks above the lanes, a lane with its marks, the steps to go.
const [HEAD, LANE, MARK, CURVE] = [14, 22, 9, 30];
// Distance from both edges to the first and last step, so that their marks are whole.
const EDGE = 8;

export class Timeline {
  /** @param {HTMLElement} root @param {Player} player @param {Words[]} words */
  constructor(root, player, words) {
    this.player = player;
    this.words = words;
    this.head = element("div", { class: "head", "aria-hidden": "true" });
    this.tip = element("output", { class: "tip", hidden: true, "aria-hidden": "true" });
    this.canvases = player.reels.map(() => element("canvas", { "aria-hidden": "true" }));
    this.track = element(
      "div", { class: "track", role: "slider", tabindex: 0, "aria-valuemin": 0, tabIndex: 0 },
      ...this.canvases, this.head, this.tip,
    );
    this.track.setAttribute("aria-label", text("lane"));
    this.names = player.reels.map((reel) => element("div", { class: "names" }, ...reel.task.players
      .map((_, seat) => element("span", {}, seatMark(seat), element("span", {})))));
    root.replaceChildren(element("div", { class: "gutter" }, ...this.names), this.track);
    this.width = 0;
    /** @type {{first: number, last: number, row: number, colour: string}[]} Labels of a coder. */
    this.spans = [];
    new ResizeObserver(() => this.draw()).observe(this.track);
    this.listen();
  }

  listen() {
    const { track, player } = this;
    let held = false;
    let playing = false;
    const go = (/** @type {PointerEvent} */ event) => player.seek(this.placeAt(event));
    track.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      track.setPointerCapture(event.pointerId);
      [held, playing] = [true, player.playing];
      player.playing = false;
      go(event);
    });
    track.addEventListener("pointermove", (event) => {
      if (held) go(event);
      this.point(event);
    });
    const release = () => {
      if (held && playing) player.play(true);
      held = false;
    };
    track.addEventListener("pointerup", release);
    track.addEventListener("pointercancel", release);
    track.addEventListener("pointerleave", () => (this.tip.hidden = true));
  }

  /** Return the position at the mouse or finger. @param {PointerEvent} event */
  placeAt(event) {
    const inside = event.clientX - this.track.getBoundingClientRect().left - EDGE;
    const at = (inside / Math.max(1, this.width - 2 * EDGE)) * this.player.end;
    // A position in steps is the nearest step, so that a seek to it is exact.
    return this.player.inTime ? at : Math.round(at);
  }

  /** Show the step and time at the mouse. @param {PointerEvent} event */
  point(event) {
    const { player, tip } = this;
    const reel = player.longest;
    const at = Math.min(player.end, Math.max(0, this.placeAt(event)));
    const step = player.inTime ? reel.stepAt(at) : Math.min(reel.last, at);
    setText(tip, `${text("step", { step, last: reel.last })} · ${clock(reel.times[step] / 1000)}`);
    tip.hidden = false;
    const half = tip.offsetWidth / 2;
    const x = event.clientX - this.track.getBoundingClientRect().left;
    tip.style.left = `${Math.min(this.width - half, Math.max(half, x))}px`;
  }

  /** @param {number} place */
  x(place) {
    return EDGE + (place / Math.max(1, this.player.end)) * (this.width - 2 * EDGE);
  }

  /** Show where the playhead is, and who plays. */
  update() {
    const { player, track } = this;
    const reel = player.longest;
    const step = player.stepOf(reel);
    this.head.style.transform = `translateX(${this.x(player.inTime ? player.at : step)}px)`;
    track.setAttribute("aria-valuemax", String(reel.last));
    track.setAttribute("aria-valuenow", String(step));
    const words = text("step", { step, last: reel.last });
    track.setAttribute("aria-valuetext", `${words}, ${clock(reel.times[step] / 1000)}`);
    player.reels.forEach((each, run) => {
      each.task.players.forEach((_, seat) => {
        const label = /** @type {HTMLElement} */ (this.names[run].children[seat].lastElementChild);
        setText(label, this.words[run].name(seat, player.stepOf(each)));
      });
    });
  }

  /** Draw everything except the playhead. */
  draw() {
    this.width = this.track.clientWidth;
    this.canvases.forEach((canvas, run) => this.drawRun(canvas, run));
    this.update();
  }

  /** @param {HTMLCanvasElement} canvas @param {number} run */
  drawRun(canvas, run) {
    const reel = this.player.reels[run];
    const seats = reel.task.players.length;
    const height = HEAD + seats * LANE + (reel.raw.to_go ? CURVE : 0);
    canvas.width = Math.max(1, Math.round(this.width * devicePixelRatio));
    canvas.height = Math.round(height * devicePixelRatio);
    canvas.style.height = `${height}px`;
    this.names[run].style.height = `${height}px`;
    const context = /** @type {Context} */ (canvas.getContext("2d"));
    context.scale(canvas.width / Math.max(1, this.width), devicePixelRatio);
    for (let seat = 0; seat < seats; seat += 1) this.lane(context, run, seat);
    if (reel.raw.to_go) this.curve(context, run, HEAD + seats * LANE);
    for (const { first, last, row, colour } of this.spans) {
      const [left, right] = [this.x(first), this.x(last)];
      context.fillStyle = colour;
      context.fillRect(left - 1.5, 1 + (row % 4) * 3, right - left + 3, 2.5);
    }
    this.marks(context, run);
  }

  /** Return the first step at each column of pixels, and that of the end. @param {number} run */
  columns(run) {
    const { player } = this;
    const reel = player.reels[run];
    const columns = Math.max(1, Math.ceil(this.x(player.endOf(reel)) - EDGE));
    return Array.from({ length: columns + 1 }, (_, column) => {
      const place = (column / columns) * player.endOf(reel);
      return player.inTime ? reel.stepAt(place) : Math.floor(place);
    });
  }

  /** @param {Context} context @param {number} run @param {number} seat */
  lane(context, run, seat) {
    const reel = this.player.reels[run];
    /** @type {string} */
    const letters = reel.raw.lanes[seat];
    const top = HEAD + seat * LANE;
    const [bottom, high] = [top + LANE - 2, LANE - MARK - 2];
    context.fillStyle = TRACK;
    context.fillRect(EDGE, top + 1, this.x(this.player.endOf(reel)) - EDGE, LANE - 3);
    const steps = this.columns(run);
    const gaps = reel.last < this.width / 6;
    for (let column = 0; column + 1 < steps.length; column += 1) {
      const first = Math.min(reel.last - 1, steps[column]);
      const span = letters.slice(first, Math.max(first + 1, steps[column + 1]));
      // With room for it, a gap shows where each step begins.
      if (gaps && column && steps[column] !== steps[column - 1]) continue;
      let rest = bottom;
      for (const [letter, [colour, height]] of ACTIVITIES) {
        const share = span.length === 1 ? Number(span === letter)
          : (span.split(letter).length - 1) / span.length;
        if (!share) continue;
        const part = Math.max(1, high * height * share);
        context.fillStyle = colour;
        context.fillRect(EDGE + column, rest - part, 1.02, part);
        rest -= part;
      }
    }
  }

  /**
   * Draw the steps to go of the shortest known plan; red where the goal is out of reach.
   * @param {Context} context @param {number} run @param {number} top
   */
  curve(context, run, top) {
    const { to_go: rows, steps: last } = this.player.reels[run].raw;
    // A call takes 100,000 arguments or so, and a recording may have a million steps.
    const highest = rows.reduce((/** @type {number} */ most, /** @type {any} */ row) =>
      Math.max(most, row?.[1] ?? row?.[0] ?? 0), 1);
    const columns = this.columns(run);
    const y = (/** @type {number} */ left) => top + CURVE - 2 - (left / highest) * (CURVE - 8);
    context.fillStyle = TRACK;
    context.fillRect(EDGE, top + 2, columns.length - 1, CURVE - 4);
    columns.slice(0, -1).forEach((step, column) => {
      const row = rows[Math.min(last, step)];
      if (!row) return;
      const [least, most] = row;
      const x = EDGE + column;
      context.fillStyle = least < 0 ? BAD : "#8a6d3e";
      if (least < 0) return context.fillRect(x, top + 2, 1.02, CURVE - 4);
      context.fillRect(x, y(most ?? least), 1.02, top + CURVE - 2 - y(most ?? least));
      context.fillStyle = most === null ? "#8a6d3e" : ACCENT;
      context.fillRect(x, y(most ?? least) - 1, 1.02, 2);
    });
  }

  /** @param {Context} context @param {number} run */
  marks(context, run) {
    const { player } = this;
    const reel = player.reels[run];
    const taken = new Set();
    const crowded = reel.log.length > this.width / 2;
    for (const { kind, seat, step, ms } of reel.log) {
      const mark = MARKS.get(kind);
      if (!mark) continue;
      const x = this.x(player.inTime ? Math.min(ms, reel.times[reel.last]) : step);
      const y = seat < 0 ? 1 : HEAD + seat * LANE + 2;
      const key = `${Math.round(crowded ? x : x / 2)} ${kind} ${seat}`;
      if (taken.has(key)) continue;
      taken.add(key);
      drawMark(context, mark, x, y, seat < 0 ? 11 : 8);
    }
  }
}

/**
 * Draw a mark below a point.
 * @param {Context} context @param {[string, string]} mark
 * @param {number} x @param {number} y @param {number} size
 */
export function drawMark(context, [shape, colour], x, y, size) {
  const half = size / 2;
  context.fillStyle = colour;
  context.strokeStyle = shape === "ring" ? colour : "#26222b";
  context.lineWidth = shape === "ring" ? 2 : 1;
  context.beginPath();
  if (shape === "circle" || shape === "ring") {
    context.arc(x, y + half, shape === "ring" ? half - 1 : half, 0, 2 * Math.PI);
  } else if (shape === "bars") {
    context.rect(x - half + 1, y, half - 2, size);
    context.rect(x + 1, y, half - 2, size);
  } else {
    const points = { triangle: [-1, 0, 1, 0, 0, 2], diamond: [0, 0, 1, 1, 0, 2, -1, 1],
      flag: [-1, 0, 1, 0, 1, 1.2, -0.5, 1.2, -0.5, 2, -1, 2] }[shape] ?? [];
    for (let i = 0; i < points.length; i += 2) {
      context.lineTo(x + points[i] * half, y + points[i + 1] * half);
    }
    context.closePath();
  }
  context.stroke();
  if (shape !== "ring") context.fill();
}
