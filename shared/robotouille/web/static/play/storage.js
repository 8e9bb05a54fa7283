// What a browser keeps between visits. Browsers may forbid it; the page then forgets.

const PREFIX = "robotouille.";
const MAX_SEATS = 20;

/** @type {Map<string, string>} */
const forgotten = new Map();

/** @param {string} key */
export function recall(key) {
  try {
    return localStorage.getItem(PREFIX + key);
  } catch {
    return forgotten.get(key) ?? null;
  }
}

/** Keep a value; null removes it. @param {string} key @param {string | null} value */
export function keep(key, value) {
  try {
    if (value === null) localStorage.removeItem(PREFIX + key);
    else localStorage.setItem(PREFIX + key, value);
  } catch {
    if (value === null) forgotten.delete(key);
    else forgotten.set(key, value);
  }
}

/**
 * Return the seats that this browser has held, the latest last: pairs of kitchen and token.
 * @returns {[string, string][]}
 */
function seats() {
  try {
    const found = JSON.parse(recall("seats") ?? "[]");
    if (!Array.isArray(found)) return [];
    return found.filter(Array.isArray).map(([kitchen, token]) => [`${kitchen}`, `${token}`]);
  } catch {
    return [];
  }
}

/**
 * Return the key of a seat: the code without its dash, and a personal link's own part. Several
 * people may use one browser.
 * @param {string} code @param {string} [link]
 */
export function seatKey(code, link = "") {
  return `${code.toUpperCase().replace(/[^A-Z]/g, "")}.${link.split(".")[1] ?? ""}`;
}

/** Return the token that leads back to a seat. @param {string} kitchen */
export function seatToken(kitchen) {
  return seats().find(([name]) => name === kitchen)?.[1];
}

/** Keep the token of a seat; null forgets it. @param {string} kitchen @param {string | null} token */
export function keepSeat(kitchen, token) {
  const rest = seats().filter(([name]) => name !== kitchen);
  if (token !== null) rest.push([kitchen, token]);
  keep("seats", JSON.stringify(rest.slice(-MAX_SEATS)));
}
