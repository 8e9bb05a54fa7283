// Kitchen for two players on Colyseus, which does the work that the load test asks of our server.
//
// node server.mjs FOLDER RATE
//
// A room takes RATE steps per second. It checks each input, keeps the last one of each player for
// the next step, appends each step to the room's file in FOLDER, and only then sends the patch.

import fs from "node:fs";
import path from "node:path";
import { Room, Server } from "@colyseus/core";
import { schema, t } from "@colyseus/schema";
import { WebSocketTransport } from "@colyseus/ws-transport";

const [folder, rate] = [process.argv[2], Number(process.argv[3])];

// The stations, items and players of the task multi_agent/01.
const STATIONS = ["table1", "table2", "stove1", "table3", "table4", "table5", "board1", "table6", "table7"];
const ITEMS = { bottombun1: "table2", topbun1: "table3", patty1: "table4", lettuce1: "table6" };
const PLAYERS = { robot1: "table2", robot2: "table1" };
// The load test sends nothing but moves, so the other actions have a form but no effect.
const ARGUMENTS = { move: 3, pick_up: 3, place: 3, stack: 3, unstack: 3, cook: 3, cut: 3 };

const Station = schema({ kind: t.string(), item: t.string(), player: t.string() }, "Station");
const Item = schema({ at: t.string(), on: t.string(), done: t.boolean() }, "Item");
const Player = schema({ at: t.string(), holding: t.string(), present: t.boolean(), seq: t.uint32() }, "Player");
const Kitchen = schema({
  phase: t.string(),
  step: t.uint32(),
  stations: t.map(Station),
  items: t.map(Item),
  players: t.map(Player),
}, "Kitchen");

function kitchen() {
  const state = new Kitchen();
  state.phase = "waiting";
  state.step = 0;
  for (const name of STATIONS) {
    const kind = name.slice(0, -1);
    state.stations.set(name, new Station().assign({ kind, item: "", player: "" }));
  }
  for (const [name, at] of Object.entries(ITEMS)) {
    state.items.set(name, new Item().assign({ at, on: at, done: false }));
    state.stations.get(at).item = name;
  }
  for (const [name, at] of Object.entries(PLAYERS)) {
    state.players.set(name, new Player().assign({ at, holding: "", present: false, seq: 0 }));
    state.stations.get(at).player = name;
  }
  return state;
}

class KitchenRoom extends Room {
  maxClients = 2;
  // The room sends its patches itself, one after each step.
  patchRate = null;
  maxMessagesPerSecond = 50;
  state = kitchen();
  chosen = new Map();
  received = new Map();

  onCreate() {
    this.file = fs.openSync(path.join(folder, `${this.roomId}.jsonl`), "ax");
    this.append({ kind: "header", state: this.state.toJSON() });
    this.onMessage("act", (client, message) => this.act(client, message));
  }

  onJoin(client) {
    const name = Object.keys(PLAYERS).find((player) => !this.state.players.get(player).present);
    client.userData = name;
    this.state.players.get(name).present = true;
    this.append({ kind: "join", step: this.state.step, player: name });
    if (this.clients.length === 2) {
      this.state.phase = "running";
      this.setTimestep(() => this.takeStep(), 1000 / rate);
    }
    this.broadcastPatch();
  }

  act(client, message) {
    const reason = this.problem(client.userData, message);
    if (reason) {
      client.send("rejected", { seq: message?.seq ?? 0, reason });
      return;
    }
    this.received.set(client.userData, message.seq);
    this.chosen.set(client.userData, message);
  }

  // Returns why an input is refused, or an empty string.
  problem(player, message) {
    if (typeof message !== "object" || message === null) return "not an object";
    const { seq, action } = message;
    if (!Number.isInteger(seq) || seq < 1 || seq > 0xffffffff) return "invalid seq";
    if (seq <= (this.received.get(player) ?? 0)) return "old seq";
    if (this.state.phase !== "running") return "not running";
    if (action === null) return "";
    if (typeof action !== "object") return "invalid action";
    const { name, args } = action;
    if (typeof name !== "string" || !Object.hasOwn(ARGUMENTS, name)) return "unknown action";
    if (!Array.isArray(args) || args.length !== ARGUMENTS[name]) return "wrong number of arguments";
    if (!args.every((arg) => typeof arg === "string" && arg.length <= 64)) return "invalid argument";
    return this.unmet(player, args);
  }

  // Returns why a player cannot move now, or an empty string.
  unmet(player, [who, from, to]) {
    if (who !== player) return "another player";
    const [here, there] = [this.state.stations.get(from), this.state.stations.get(to)];
    if (!here || !there) return "unknown station";
    if (this.state.players.get(player).at !== from) return "not there";
    return there.player === "" ? "" : "occupied";
  }

  takeStep() {
    const state = this.state;
    state.step += 1;
    const [did, seq] = [[], []];
    for (const [player, message] of this.chosen) {
      state.players.get(player).seq = message.seq;
      seq.push(message.seq);
      if (message.action === null) continue;
      const { name, args } = message.action;
      did.push([player, name, ...args]);
      // An earlier action of this step may have taken the station.
      if (name === "move" && !this.unmet(player, args)) this.move(player, args[1], args[2]);
    }
    this.chosen.clear();
    this.append({ kind: "step", step: state.step, at: Date.now(), did, seq });
    this.broadcastPatch();
  }

  move(player, from, to) {
    this.state.stations.get(from).player = "";
    this.state.stations.get(to).player = player;
    this.state.players.get(player).at = to;
  }

  // Our server hands each step to the operating system and syncs nothing, so this one does, too.
  append(entry) {
    fs.writeSync(this.file, JSON.stringify(entry) + "\n");
  }

  onDispose() {
    fs.closeSync(this.file);
  }
}

// Our server pings every 20 seconds, too; the default is 3.
const transport = new WebSocketTransport({ pingInterval: 20_000 });
const server = new Server({ transport, greet: false });
server.define("kitchen", KitchenRoom);
await server.listen(0, "127.0.0.1", 4096);
console.log(`colyseus at ws://127.0.0.1:${transport.server.address().port}`);
