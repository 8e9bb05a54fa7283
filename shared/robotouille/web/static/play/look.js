// The look of a kitchen: shipped ones come as files, others over the conversation.

import { Look } from "../kitchen/look.js";

/** @typedef {import("../rules/task.js").Task} Task */
/** @typedef {import("./connection.js").Message} Message */
/** @typedef {(message: Message) => Promise<Message>} Ask */

const FILES = new URL("../", import.meta.url);
const SHIPPED_KITCHEN = "robotouille";
const SHIPPED_PICTURES = "kitchen";
const MAX_PICTURES = 500;
const TRIES = 60;
const RETRY_MS = 1000;

/**
 * Return the look of a task, with its pictures, words and key bindings.
 * @param {Task} task @param {Message} own The answer to `get_rendering`. @param {Ask} ask
 */
export async function loadLook(task, own, ask) {
  const { rendering, bindings } = own.rendering
    ? { rendering: own.rendering, bindings: own.bindings ?? {} }
    : await shippedLook(task.domain.name);
  const folders = [rendering.assets ?? SHIPPED_PICTURES, ...(rendering.inherited_assets ?? [])];
  const pictures = await shippedPictures(folders);
  await ownPictures(new Map(Object.entries(own.pictures ?? {})), pictures, ask);
  return new Look({ rendering, bindings, pictures });
}

/** @param {string} domain */
async function shippedLook(domain) {
  const found = await file(`looks/${encodeURIComponent(domain)}.json`);
  const own = found ?? (await file(`looks/${SHIPPED_KITCHEN}.json`));
  if (own === null) throw new Error("the page's files are of another version");
  return own;
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
      const answer = await ask({ type: "get_picture", digest });
      if (answer.type === "picture") {
        const kind = name.endsWith(".svg") ? "image/svg+xml" : "image/png";
        pictures.set(name, `data:${kind};base64,${answer.data}`);
        break;
      }
      if (answer.code !== "rate/limited") break;
      await new Promise((done) => setTimeout(done, RETRY_MS));
    }
  }
}

/** @type {Map<string, Promise<any>>} Files that were requested, by name. */
const files = new Map();

/** Return a file of the page; null if it does not exist. @param {string} name */
function file(name) {
  const known = files.get(name);
  if (known) return known;
  const found = fetched(name, TRIES);
  files.set(name, found);
  found.catch(() => files.delete(name));
  return found;
}

/** @param {string} name @param {number} tries @returns {Promise<any>} */
async function fetched(name, tries) {
  try {
    const answer = await fetch(new URL(name, FILES));
    return answer.ok ? await answer.json() : null;
  } catch (error) {
    if (tries <= 1) throw error;
  }
  // The connection was lost. The game comes back as soon as it is there again.
  await new Promise((done) => setTimeout(done, RETRY_MS));
  return fetched(name, tries - 1);
}
