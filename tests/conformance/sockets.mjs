// WebSocket itself: fragments, pings, close codes, subprotocols, sizes.

import { JSON_PROTOCOL, MSGPACK_PROTOCOL, Session, within } from "./session.mjs";

/** A message in as many frames as it has bytes, with pings between them. */
export async function fragments({ url, subprotocol }) {
  const session = await Session.open(url, [subprotocol]);
  const pongs = [];
  session.socket.on("pong", (data) => pongs.push(data.toString()));
  const bytes = Buffer.from(session.pack({ type: "hello", protocol: 1, name: "adá🍟", ref: 7 }));
  for (let i = 0; i < bytes.length; i++) {
    const options = { binary: !session.text, fin: i === bytes.length - 1 };
    session.socket.send(bytes.subarray(i, i + 1), options);
    if (i % 10 === 0) session.socket.ping(`ping ${i}`);
  }
  const welcome = await session.expect("welcome", "error");
  await session.close();
  return { welcome, frames: bytes.length, pongs };
}

/** Close with these codes; what the server answers to each. */
export async function closings({ url, codes }) {
  const answers = [];
  for (const code of codes) {
    const session = await Session.open(url, [JSON_PROTOCOL]);
    await session.hello("ada");
    answers.push((await session.close(code, "enough")).code);
  }
  return answers;
}

/** Text frames where binary ones are due, and the other way round. */
export async function mixups({ url }) {
  const answers = {};
  for (const subprotocol of [JSON_PROTOCOL, MSGPACK_PROTOCOL]) {
    const session = await Session.open(url, [subprotocol]);
    session.socket.send(JSON.stringify({ type: "list" }), { binary: session.text });
    const error = await session.expect("error");
    const welcome = await session.hello("ada");
    answers[subprotocol] = [error.code, welcome.type];
    await session.close();
  }
  return answers;
}

/** Which subprotocol is chosen of each offer; an error's words where `ws` refuses the answer. */
export async function offers({ url, offers }) {
  const chosen = [];
  for (const offer of offers) {
    try {
      const session = await Session.open(url, offer);
      const { type } = await session.hello("ada");
      chosen.push([session.socket.protocol, session.heard[0].binary ? "binary" : "text", type]);
      await session.close();
    } catch (error) {
      chosen.push(error.message);
    }
  }
  return chosen;
}

/** A message just too large, and one far too large. */
export async function oversized({ url, large, huge }) {
  const session = await Session.open(url, [JSON_PROTOCOL]);
  await session.hello("ada");
  session.socket.send("x".repeat(large));
  const error = await session.expect("error");
  const { type } = await session.ask({ type: "list" }, "episodes");
  session.socket.send("x".repeat(huge));
  const { code } = await within(session.closed, "the end");
  return { error: error.code, then: type, code };
}

/** Extensions that were agreed upon although compression was offered. */
export async function compression({ url }) {
  const session = await Session.open(url, [JSON_PROTOCOL], { perMessageDeflate: true });
  const { type } = await session.hello("ada");
  const { extensions } = session.socket;
  await session.close();
  return { extensions, type };
}
