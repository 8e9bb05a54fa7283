// The look of a kitchen: shipped ones come as files, others over the conversation.

import { Look } from "../kitchen/look.js";

/** @typedef {import("../rules/task.js").Task} Task */
/** @typedef {import("./connection.js").Message} Message */
/** @typedef {(message: Message, answer: string) => Promise<Message>} Ask */

const FILES = new URL("../", import.meta.url);
const SHIPPED_KITCHEN = "robotouille";
const MAX_PICTURES = 500;
const TRIES = 10;

/**
 * Return the look of a task, with its pictures, words and key bindings.
 * @param {Task} task @param {Ask} ask
 */
export async function loadLook(task, ask) {
  const own = await ask({ type: "get_rendering" }, "rendering");
  const { rendering, bindings } = own.rendering
    ? { rendering: own.rendering, bindings: own.bindings ?? {} }
    : await shippedLook(task.domain.name);
  const folders = [rendering.assets ?? "kitchen", ...(rendering.inherited_assets ?? [])];
  const pictures = await shippedPictures(folders);
  await ownPictures(new Map(Object.entries(own.pictures ?? {})), pictures, ask);
  return new Look({ rendering, bindings, pictures });
}

/** @param {string} domain */
async function shippedLook(domain) {
  const found = await file(`looks/${encodeURIComponent(domain)}.json`);
  return found ?? (await file(`looks/${SHIPPED_KITCHEN}.json`));
}

/**
 * Return the shipped pictures by file name; those of an earlier folder come first.
 * @param {string[]} folders
 */
async function shippedPictures(folders) {
  const found = await Promise.all(
    folders.map((folder) => file(`pictures/${encodeURIComponent(folder)}.json`)),
  );
  /** @type {Map<string, string>} */
  const pictures = new Map();
  for (const each of found.reverse()) {
    for (const [name, svg] of Object.entries(each ?? {})) pictures.set(name, svg);
  }
  return pictures;
}

/**
 * Add the pictures of a kitchen that is not shipped.
 * @param {Map<string, string>} digests @param {Map<string, string>} pictures @param {Ask} ask
 */
async function ownPictures(digests, pictures, ask) {
  for (const [name, digest] of [...digests].slice(0, MAX_PICTURES)) {
    for (let tried = 0; tried < TRIES; tried += 1) {
      const answer = await ask({ type: "get_picture", digest }, "picture");
      if (answer.type === "picture") {
        const kind = name.endsWith(".svg") ? "image/svg+xml" : "image/png";
        pictures.set(name, `data:${kind};base64,${answer.data}`);
        break;
      }
      if (answer.code !== "rate/limited") break;
      await new Promise((done) => setTimeout(done, 1000));
    }
  }
}

/** @param {string} name */
async function file(name) {
  const answer = await fetch(new URL(name, FILES));
  return answer.ok ? answer.json() : null;
}
