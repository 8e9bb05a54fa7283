// The page inside another page, such as a survey: `?embed=ORIGIN` names the parent's origin.

/** @typedef {"ready" | "started" | "step" | "ended" | "left"} News */

const SOURCE = "robotouille";
const options = new URLSearchParams(location.search);

/** Return the origin of a web address; empty if it is none. @param {string | null} address */
function originOf(address) {
  const url = parsed(address);
  return url === null ? "" : url.origin;
}

/** Return a web address as an object; null for other texts. @param {string | null} address */
function parsed(address) {
  try {
    const url = new URL(address ?? "");
    return /^https?:$/.test(url.protocol) ? url : null;
  } catch {
    return null;
  }
}

/** The origin of the page around this one, which may send commands; empty without one. */
export const parentOrigin = window.parent === window ? "" : originOf(options.get("embed"));

/** The name that the address gives the participant. */
export const givenName = (options.get("name") ?? "").trim().slice(0, 40);

/** The address to which the participant goes on after the game; null without one. */
export function nextAddress() {
  return parsed(options.get("return"));
}

/** Tell the parent what happened. @param {News} type @param {object} [details] */
export function tellParent(type, details = {}) {
  // A browser delivers the message only if the parent has this origin.
  if (parentOrigin) window.parent.postMessage({ source: SOURCE, type, ...details }, parentOrigin);
}

/**
 * Run commands of the parent: `{type: "ready"}` and `{type: "leave"}`.
 * @param {Record<string, () => void>} commands @param {AbortSignal} signal
 */
export function obeyParent(commands, signal) {
  const obey = (/** @type {MessageEvent} */ { origin, source, data }) => {
    if (!parentOrigin || origin !== parentOrigin || source !== window.parent) return;
    const type = data?.source === undefined ? data?.type : undefined;
    if (typeof type === "string" && Object.hasOwn(commands, type)) commands[type]();
  };
  addEventListener("message", obey, { signal });
}
