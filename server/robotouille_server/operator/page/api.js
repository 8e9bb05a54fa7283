// Requests to the server: reads, changes, event streams and downloads.

import { askToken } from "./dialogs.js";
import { saveAs } from "./dom.js";

const KEY = "robotouille-operator-token";
const REFUSED = "event: refused\ndata: ";
let token = sessionStorage.getItem(KEY) ?? "";
let asking = null;

export class Refused extends Error {
  constructor(status, { code, message, field = "" }) {
    super(message);
    this.status = status;
    this.code = code;
    this.field = field;
  }
}

async function send(path, options = {}) {
  for (;;) {
    const used = token;
    const headers = { ...options.headers };
    if (used) headers.Authorization = `Bearer ${used}`;
    const response = await fetch(path, { ...options, headers, cache: "no-store" });
    if (response.ok) return response;
    const problem = await response.json().catch(() => ({ code: "", message: response.statusText }));
    if (response.status !== 401) throw new Refused(response.status, problem);
    if (token === used) await renewToken(used ? problem.message : "");
  }
}

// Several requests can fail at once, so all of them wait for one dialog.
async function renewToken(fault) {
  asking ??= askToken(fault).then((given) => {
    token = given;
    sessionStorage.setItem(KEY, given);
    asking = null;
  });
  await asking;
}

export const get = async (path) => (await send(path)).json();

// The content of compressed JSON.
export async function getPacked(path) {
  const { body } = await send(path);
  return new Response(body.pipeThrough(new DecompressionStream("gzip"))).json();
}

export async function post(path, body = {}) {
  const headers = { "Content-Type": "application/json", "X-Robotouille-Operator": "1" };
  return (await send(path, { method: "POST", headers, body: JSON.stringify(body) })).json();
}

// A plain link cannot send a token, so with a token the file is fetched first.
export async function download(event) {
  if (!token) return;
  event.preventDefault();
  const { href, download: name } = event.currentTarget;
  saveAs(await (await send(href)).blob(), name);
}

// Server-sent events, with reconnection. `received` gets each value, `linked` gets whether the
// stream is open, and `gone` gets the final refusal. EventSource cannot send a token, so this uses
// fetch. If the token has expired, the stream reconnects at once, which asks for a new token.
export function follow(path, { received, linked = () => {}, gone = () => {} }) {
  const stop = new AbortController();
  (async () => {
    let wait = 250;
    while (!stop.signal.aborted) {
      try {
        const response = await send(path, { signal: stop.signal });
        linked(true);
        wait = 250;
        await readEvents(response.body, received);
      } catch (problem) {
        if (stop.signal.aborted) return;
        if (problem instanceof Refused && [403, 404].includes(problem.status)) return gone(problem);
        if (problem instanceof Refused && problem.code.startsWith("auth/")) wait = 0;
      }
      if (stop.signal.aborted) return;
      linked(false);
      await new Promise((resolve) => setTimeout(resolve, wait * (0.75 + Math.random() / 2)));
      wait = Math.min(5000, Math.max(250, wait * 2));
    }
  })();
  return () => stop.abort();
}

async function readEvents(body, received) {
  const reader = body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    for (let end; (end = text.indexOf("\n\n")) >= 0; text = text.slice(end + 2)) {
      const event = text.slice(0, end);
      if (event.startsWith("data: ")) received(JSON.parse(event.slice(6)));
      if (event.startsWith(REFUSED)) {
        throw new Refused(0, JSON.parse(event.slice(REFUSED.length)));
      }
    }
  }
}
