// Bots of Colyseus rooms, which do what the bots of `robotouille-loadtest` do.
//
// node clients.mjs URL ROOMS RATE RAMP SETTLE SECONDS
//
// In each room, one bot sends one input a step, in the middle of the step, and the other watches.
// Prints a line when the measurement begins, and the results as JSON when it ends.

import { Client } from "@colyseus/sdk";
import WebSocket from "ws";

// Newer versions of Node have a WebSocket of their own, which is slower and hides its socket.
globalThis.WebSocket = WebSocket;

const [url, ...numbers] = process.argv.slice(2);
const [rooms, rate, ramp, settle, seconds] = numbers.map(Number);
const PERIOD = 1000 / rate;
// Steps of the measurement before the first input, as many as the load test's bots wait.
const SETTLED = 5;
const LATE = 50;
const TICK = 20;
const MOVES = [
  { name: "move", args: ["robot1", "table2", "stove1"] },
  { name: "move", args: ["robot1", "stove1", "table2"] },
];

const client = new Client(url);
const counts = { rooms: 0, steps: 0, inputs: 0, rejected: 0, onTime: 0, received: 0, problems: [] };
const sockets = [];
const lags = [];
let measuring = false;

const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

class Actor {
  constructor(room) {
    this.room = room;
    this.place = 0;
    this.seq = 0;
    this.step = 0;
    this.waiting = false;
    this.due = false;
    this.wait = PERIOD * (0.25 + 0.5 * Math.random());
    this.steps = 0;
    this.last = 0;
    room.onStateChange((state) => this.changed(state));
    room.onMessage("rejected", () => {
      counts.rejected += 1;
      this.waiting = false;
    });
  }

  changed(state) {
    counts.received += measuring;
    if (state.phase !== "running" || state.step === this.step) return;
    this.step = state.step;
    const player = state.players.get("robot1");
    this.place = player.at === "table2" ? 0 : 1;
    if (player.seq >= this.seq) this.waiting = false;
    if (measuring) this.arrived(performance.now());
    if (!measuring || this.steps >= SETTLED) setTimeout(() => this.act(), this.wait);
    if (this.due) this.act();
  }

  // The intervals of Colyseus have no fixed schedule, so a step is late from the previous one.
  arrived(at) {
    counts.steps += 1;
    if (this.steps === 0 || at - this.last - PERIOD < LATE) counts.onTime += 1;
    this.steps += 1;
    this.last = at;
  }

  act() {
    // Like the load test's bots, this one sends nothing before the previous input was answered.
    this.due = this.waiting;
    if (this.waiting || !this.room.connection.isOpen) return;
    this.waiting = true;
    this.seq += 1;
    this.room.send("act", { seq: this.seq, action: MOVES[this.place] });
    counts.inputs += measuring;
  }
}

async function open() {
  try {
    const first = await client.create("kitchen", {});
    sockets.push(first.connection.transport.ws._socket);
    const actor = new Actor(first);
    const second = await client.joinById(actor.room.roomId, {});
    sockets.push(second.connection.transport.ws._socket);
    second.onStateChange(() => {
      counts.received += measuring;
    });
    counts.rooms += 1;
  } catch (error) {
    if (counts.problems.length < 5) counts.problems.push(String(error));
  }
}

function traffic() {
  const sum = (key) => sockets.reduce((total, socket) => total + socket[key], 0);
  return [sum("bytesRead"), sum("bytesWritten")];
}

function watchLag(due) {
  const now = performance.now();
  if (measuring) lags.push(Math.max(0, now - due));
  setTimeout(watchLag, TICK, now + TICK);
}

const begun = performance.now();
const opening = [];
for (let number = 0; number < rooms; number += 1) {
  await sleep(begun + (ramp * 1000 * number) / rooms - performance.now());
  opening.push(open());
}
await Promise.all(opening);
await sleep(settle * 1000);
watchLag(performance.now());
const before = traffic();
const cpu = process.cpuUsage();
measuring = true;
console.log("measuring");
const start = performance.now();
await sleep(seconds * 1000);
measuring = false;
const took = (performance.now() - start) / 1000;
const after = traffic();
const used = process.cpuUsage(cpu);
lags.sort((a, b) => a - b);
console.log(JSON.stringify({
  ...counts,
  seconds: took,
  bytesIn: after[0] - before[0],
  bytesOut: after[1] - before[1],
  cores: (used.user + used.system) / 1e6 / took,
  lag: lags[Math.floor(lags.length * 0.99)] / 1000,
}));
// The server is stopped next, so the connections need no farewell.
process.exit();
