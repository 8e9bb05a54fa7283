// Lets the browser client take part in a conversation. Each line of standard input is an event; for
// each one, a line of the output has what the client sends, and its copy of the game.
import { createInterface } from "node:readline";

const PLAY = new URL("../../shared/robotouille/web/static/play/", import.meta.url);
const load = (name) => import(new URL(`${name}.js`, PLAY).href);
const { atomName } = await load("../rules/task");

let time = 0;
let sent = [];
let answers = [];
let chat = [];
/** @type {any} The last connection; null after its end. */
let socket = null;
let url = "";

class FakeSocket {
  static OPEN = 1;
  constructor(address) {
    this.readyState = 0;
    url = address;
    socket = this;
  }
  send(text) {
    sent.push(JSON.parse(text));
  }
  close() {
    if (socket === this) socket = null;
  }
}
// Nothing happens by itself: the events open connections and let time pass.
Object.assign(globalThis, {
  WebSocket: FakeSocket, addEventListener: () => {}, setTimeout: () => 0, setInterval: () => 0,
});
Date.now = performance.now = () => time * 1000;

const [{ Connection }, { Game }] = await Promise.all(["connection", "game"].map(load));

const game = new Game((message) => connection.send(message), (event) => {
  if (event.type === "answer") answers.push([event.sent.seq, event.applied, event.why[0]?.kind ?? ""]);
  if (event.type === "said") chat.push(event.line.text);
});
/** @type {any} */
let connection = null;

function start({ address, name, join }) {
  connection = new Connection(address, { name }, join, () => game.seen(), {
    message(message) {
      if (message.type === "joined") game.joined(message, connection.resumed);
      else game.receive(message);
    },
    status() {},
    farewell() {},
    resume() {},
  });
}

const EVENTS = {
  start,
  open() {
    connection.connectNow();
    socket.readyState = 1;
    socket.onopen();
  },
  lose: () => socket?.onclose(),
  frame: ({ data }) => socket.onmessage({ data }),
  act: ({ action }) => game.act(action),
  say: ({ text }) => game.say(text),
  wait({ seconds }) {
    time += seconds;
    if (connection.online) game.repeat();
  },
};

for await (const line of createInterface({ input: process.stdin })) {
  const event = JSON.parse(line);
  EVENTS[event.do](event);
  const { state, step, phase, seq, sent: last, outcome, seats } = game;
  const copy = {
    step, phase, seq, outcome, unanswered: last?.seq ?? null,
    facts: state ? state.atoms().map(atomName).sort() : null, seats: seats.map(({ name }) => name),
  };
  console.log(JSON.stringify({ sent, answers, chat, game: copy, url }));
  sent = [];
  answers = [];
  chat = [];
}
