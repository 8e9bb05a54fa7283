// The page's texts in the reader's language.

import english from "../texts/en.js";

const LANGUAGES = ["en", "de"];

/** @type {Record<string, string>} */
let texts = english;

/** Return the language that the address or the browser asks for. */
export function wantedLanguage() {
  const asked = new URLSearchParams(location.search).get("lang");
  const wanted = [asked, ...navigator.languages].map((name) => (name ?? "").slice(0, 2));
  return wanted.find((name) => LANGUAGES.includes(name)) ?? "en";
}

/** Load the texts of the reader's language. */
export async function loadTexts() {
  const language = wantedLanguage();
  const own = language === "en" ? english : (await import(`../texts/${language}.js`)).default;
  useTexts(language, own);
}

/**
 * Use texts in a language from now on, also for the parts of the page that name theirs.
 * @param {string} language @param {typeof texts} own
 */
export function useTexts(language, own) {
  texts = { ...english, ...own };
  document.documentElement.lang = language;
  for (const each of document.querySelectorAll("[data-text]")) {
    each.textContent = text(each.getAttribute("data-text") ?? "");
  }
  for (const each of document.querySelectorAll("[data-label]")) {
    const label = text(each.getAttribute("data-label") ?? "");
    each.setAttribute("aria-label", label);
    if (each instanceof HTMLInputElement) each.placeholder = label;
  }
}

/**
 * Return a text with its fields filled in.
 * @param {string} key @param {Record<string, string | number>} [fields]
 */
export function text(key, fields = {}) {
  return (texts[key] ?? key).replace(/\{(\w+)\}/g, (_, name) => String(fields[name] ?? ""));
}

/** Return a duration as `m:ss` or `h:mm:ss`. @param {number} seconds */
export function clock(seconds) {
  const whole = Math.max(0, Math.floor(seconds));
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  const padded = (/** @type {number} */ number) => String(number).padStart(2, "0");
  const short = `${hours ? padded(minutes) : minutes}:${padded(whole % 60)}`;
  return hours ? `${hours}:${short}` : short;
}

/**
 * Return the time that some steps take, or their number if the clock waits for decisions.
 * @param {number} steps @param {number | null} stepSeconds
 */
export const duration = (steps, stepSeconds) => stepSeconds === null
  ? text("someSteps", { steps }) : text("seconds", { seconds: Math.ceil(steps * stepSeconds) });

/**
 * Return why a dish is not served, and what to do.
 * @param {import("../rules/unserved.js").Unserved} found
 */
export const unservedWords = ({ dish, fault }) =>
  text(fault ? "unserved" : "unordered", { dish, fault });

/** Return names as a list, such as `Ada, Ben, Cem`. @param {string[]} names */
export const listed = (names) =>
  new Intl.ListFormat(document.documentElement.lang, { type: "conjunction" }).format(names);
