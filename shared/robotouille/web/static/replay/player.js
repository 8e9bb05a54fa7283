// The playhead: where the recordings are, and how fast they run.

/** @typedef {import("./reel.js").Reel} Reel */

export const SPEEDS = [0.5, 1, 2, 4, 8];
// A frame that comes late, for example in a hidden tab, moves the playhead no further than this.
const MAX_FRAME = 0.25;

/** Position of one or two recordings, in steps or in milliseconds since their start. */
export class Player {
  /** @param {Reel[]} reels @param {() => void} changed Called when anything here has changed. */
  constructor(reels, changed) {
    this.reels = reels;
    this.changed = changed;
    this.at = 0;
    this.speed = 1;
    this.playing = false;
    /** True to move in milliseconds, false to move in steps. */
    this.inTime = false;
    /** True if the last change was one step forward, which is animated. */
    this.advanced = false;
    this.drawnAt = 0;
  }

  /** The end of the longer recording. */
  get end() {
    return Math.max(...this.reels.map((reel) => this.endOf(reel)));
  }

  /** @param {Reel} reel */
  endOf(reel) {
    return this.inTime ? reel.times[reel.last] : reel.last;
  }

  /** The recording with the longer timeline, on which single steps are counted. */
  get longest() {
    return this.reels.reduce((a, b) => (this.endOf(b) > this.endOf(a) ? b : a));
  }

  /** Steps a second at the chosen speed. */
  get rate() {
    return this.reels[0].raw.rate * this.speed;
  }

  /** Return the step that a recording shows. @param {Reel} reel */
  stepOf(reel) {
    return this.inTime ? reel.stepAt(this.at) : Math.min(reel.last, Math.floor(this.at));
  }

  /** Return the position of a step of a recording. @param {Reel} reel @param {number} step */
  placeOf(reel, step) {
    return this.inTime ? reel.times[step] : step;
  }

  /** Return the seconds that a step is shown. @param {Reel} reel @param {number} step */
  secondsOf(reel, step) {
    const { times, last } = reel;
    if (!this.inTime || step >= last) return 1 / this.rate;
    return Math.min(1, Math.max(0.02, (times[step + 1] - times[step]) / 1000 / this.speed));
  }

  play(playing = !this.playing) {
    // Playing again at the end starts from the beginning.
    if (playing && this.at >= this.end) this.at = 0;
    this.playing = playing;
    this.changed();
  }

  /** Go to a position. @param {number} at */
  seek(at) {
    this.at = Math.min(this.end, Math.max(0, at));
    this.advanced = false;
    this.changed();
  }

  /** Go some steps on, or back. @param {number} count */
  move(count) {
    const reel = this.longest;
    this.playing = false;
    const step = Math.min(reel.last, Math.max(0, this.stepOf(reel) + count));
    this.seek(this.placeOf(reel, step));
    this.advanced = count === 1;
  }

  /** Change the speed by some notches. @param {number} by */
  faster(by) {
    const place = SPEEDS.indexOf(this.speed) + by;
    this.speed = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, place))];
    this.changed();
  }

  /** Count in milliseconds or in steps from now on. @param {boolean} inTime */
  count(inTime) {
    const reel = this.reels[0];
    const step = this.stepOf(reel);
    this.inTime = inTime;
    this.seek(this.placeOf(reel, step));
  }

  /** Move the playhead. @param {number} now Seconds. */
  tick(now) {
    const passed = Math.min(MAX_FRAME, now - this.drawnAt);
    this.drawnAt = now;
    if (!this.playing) return;
    this.at += passed * (this.inTime ? 1000 * this.speed : this.rate);
    this.advanced = true;
    if (this.at >= this.end) {
      this.at = this.end;
      this.playing = false;
    }
    this.changed();
  }
}
