// Whole games, and a game that goes on after the connection was cut.

import { Facts } from "./facts.mjs";
import { JSON_PROTOCOL, Session } from "./session.mjs";

/**
 * A conversation in which every type of message occurs, in the same order whatever the encoding:
 * two players, watched by a third, play `plan` to its end: for each step, what each seat does.
 */
export async function conversation({ url, subprotocol, create, seats, plan }) {
  const names = ["ada", "bob", "eve"];
  const people = [];
  for (const name of names) people.push(await Session.open(url, [subprotocol]));
  const [ada, bob, eve] = people;
  const settle = async () => {
    for (const person of people) await person.settle();
  };
  for (const [i, person] of people.entries()) await person.hello(names[i], { ref: 1 });
  await ada.ask({ type: "fly", ref: 2 }, "error");
  const { episode } = await ada.ask({ type: "create", ref: 3, ...create }, "created");
  await ada.ask({ type: "list", ref: 4 }, "episodes");
  const late = { view: "both", ready: false };
  await ada.ask({ type: "join", ref: 5, episode, seat: seats[0], ...late }, "joined");
  await settle();
  await eve.ask({ type: "join", ref: 6, episode, role: "spectator", view: "both" }, "joined");
  for (const person of [ada, eve]) {
    await first(person, "roster", (roster) => roster.spectators === 1);  // When it is due.
  }
  await settle();
  const joined = await bob.ask({ type: "join", ref: 7, episode, seat: seats[1] }, "joined");
  if (joined.type !== "joined") throw new Error(JSON.stringify(joined));
  await settle();
  ada.send({ type: "ready" });
  await settle();
  ada.send({ type: "say", text: 'I take the 🍟 — "déjà vu"\n\u0000\u202e' });
  ada.send({ type: "signal", intent: "look", target: seats[1] });
  ada.send({ type: "note", topic: "team", text: "planner 2" });
  ada.send({ type: "note", topic: "plan", text: 'first the 🍟', more: true });
  ada.send({ type: "note", topic: "plan", text: ", then nothing" });
  await settle();
  eve.send({ type: "act", seq: Number.MAX_SAFE_INTEGER, action: null });
  bob.send({ type: "act", seq: 1, action: { name: "fly", args: ["robot1"] } });
  bob.send({ type: "act", seq: 2, action: 0, basis: 99, max_age: 3, think_ms: 850, reasoning: "why not" });
  await settle();
  bob.send({ type: "resync" });
  await settle();
  const facts = new Facts(await first(eve, "snapshot"));
  const states = [facts.names()];
  for (const [step, actions] of plan.entries()) {
    for (const [seat, action] of actions) {
      people[seat].send({ type: "act", seq: step + 3, action, basis: step });
      await people[seat].settle();
    }
    await settle();
    facts.apply(await first(eve, "delta", (delta) => delta.step === step + 1));
    states.push(facts.names());
  }
  const outcome = (await first(eve, "ended")).outcome;
  await ada.ask({ type: "get_rendering", ref: 8 }, "rendering");
  await ada.ask({ type: "get_picture", ref: 9, digest: "0".repeat(64) }, "picture");
  await bob.ask({ type: "leave", ref: 8 }, "left");
  const unused = await bob.ask({ type: "create", ref: 9, ...create }, "created");
  await bob.ask({ type: "close", ref: 10, episode: unused.episode }, "closed");
  const again = await Session.open(url, [subprotocol]);
  const { resume } = await first(eve, "welcome");
  const welcome = await again.hello("eve", { resume });
  const bye = await first(eve, "bye");
  const closed = await eve.closed;
  await ada.close();
  await bob.close();
  await again.close();
  const transcript = Object.fromEntries(names.map((name, i) => [name, people[i].heard]));
  return {
    transcript: { ...transcript, again: again.heard },
    sent: people.flatMap((person) => person.sent.map((message) => message.type)),
    states,
    outcome,
    resumed: welcome.resumed ?? false,
    bye,
    closed,
  };
}

/** The first message of a type that a session has heard or hears now. */
async function first(session, type, fits = () => true) {
  for (const { message } of session.heard) {
    if (message.type === type && fits(message)) return message;
  }
  for (;;) {
    const message = await session.expect(type);
    if (fits(message)) return message;
  }
}

/** One player whose connection is cut again and again; the facts it has at every step. */
export async function cuts({ url, subprotocol, create, plan, every, seen }) {
  let session = await Session.open(url, [subprotocol]);
  let welcome = await session.hello("ada");
  const { episode } = await session.ask({ type: "create", ...create }, "created");
  await session.ask({ type: "join", episode }, "joined");
  const facts = new Facts(await session.expect("snapshot"));
  const states = [facts.names()];
  const tokens = new Set([welcome.resume]);
  let resumed = 0;
  for (const [step, [[, action]]] of plan.entries()) {
    const act = { type: "act", seq: step + 1, action, basis: step };
    session.send(act);
    if (step % every === 0) {
      session.socket.terminate();
      session = await Session.open(url, [subprotocol]);
      const known = seen ? { seen: { episode, step: facts.step } } : {};
      welcome = await session.hello("ada", { resume: welcome.resume, ...known });
      if (!welcome.resumed) throw new Error(JSON.stringify(welcome));
      tokens.add(welcome.resume);
      resumed += 1;
      await session.expect("joined");
      session.send(act);
    }
    await catchUp(session, facts, step + 1);
    states.push(facts.names());
  }
  const ended = await session.expect("ended");
  await session.close();
  return { states, resumed, tokens: tokens.size, outcome: ended.outcome };
}

/** Apply what comes, a snapshot or deltas, until the facts are those of a step. */
async function catchUp(session, facts, step) {
  while (facts.step < step) {
    const message = await session.expect("delta", "snapshot", "rejected");
    if (message.type === "rejected") throw new Error(JSON.stringify(message));
    if (message.type === "delta" && message.step > facts.step) facts.apply(message);
    if (message.type === "snapshot") Object.assign(facts, new Facts(message));
  }
}
