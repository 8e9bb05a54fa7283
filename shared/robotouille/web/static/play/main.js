// Entry of the page: reads the link, asks for a name, and enters the kitchen.

import { byId, element, inputById, setText } from "./dom.js";
import { Session } from "./session.js";
import { givenName, parentOrigin } from "./parent.js";
import { keep, recall, seatKey, seatToken } from "./storage.js";
import { loadTexts, text } from "./texts.js";

/**
 * Return what the address of the page asks for. A personal link has a token after the code, and is
 * itself the token.
 */
function invitation() {
  const link = decoded(location.hash.slice(1)).trim();
  const [code, signed = ""] = link.split(".");
  const token = signed ? link : undefined;
  return { code: code.toUpperCase(), token, watch: location.pathname.endsWith("/watch") };
}

/** Return a part of an address without escapes. @param {string} part */
function decoded(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    // A `%` without digits.
    return part;
  }
}

/** Address of the information about a study, to which people agree before they play. */
const consent = document.querySelector("meta[name=consent]")?.getAttribute("content") ?? "";

/** Return the words that keep a seat's agreement to that information. @param {string} code */
const agreement = (code) => `${seatKey(code, invitation().token)} ${consent}`;

function showForm(fault = "") {
  const { code, token, watch } = invitation();
  byId("game").hidden = true;
  byId("enter").hidden = false;
  const intro = code ? (watch ? "introWatch" : "introCode") : "intro";
  setText(byId("enter-intro"), text(intro, { code }));
  setText(byId("enter-button"), text(watch ? "watch" : "join"));
  setText(byId("enter-fault"), fault);
  byId("consent-row").hidden = watch || !consent;
  byId("consent-link").setAttribute("href", consent);
  byId("code-row").hidden = code !== "";
  if (code) inputById("code").value = code;
  // A personal link may be opened on a computer that several participants use.
  inputById("name").value ||= givenName || (token ? "" : (recall("name") ?? ""));
  inputById(code ? "name" : "code").focus();
}

function submitted() {
  const code = inputById("code").value.trim().toUpperCase();
  const name = inputById("name").value.trim();
  if (!code) return showForm(text("missingCode"));
  if (!name) return showForm(text("missingName"));
  const agreed = !byId("consent-row").hidden;
  if (agreed && !inputById("consent").checked) return showForm(text("missingConsent"));
  keep("name", name);
  if (agreed) keep("agreed", agreement(code));
  if (invitation().code !== code) history.replaceState(null, "", `#${encodeURIComponent(code)}`);
  return enter(code, name, agreed ? consent : "");
}

/**
 * @param {string} code
 * @param {string} name
 * @param {string} agreed Address of the information to which the player has agreed, or empty.
 */
function enter(code, name, agreed = "") {
  const { watch, token } = invitation();
  byId("enter").hidden = true;
  const session = new Session({ code, name, watch, token, agreed }, {
    left: (fault) => showForm(fault),
    moved: (next) => {
      const agrees = consent && recall("agreed") === agreement(code);
      if (agrees) keep("agreed", agreement(next));
      history.replaceState(null, "", `#${encodeURIComponent(next)}`);
      enter(next, name, agrees ? consent : "");
    },
    watch: () => {
      history.replaceState(null, "", `watch${location.search}#${encodeURIComponent(code)}`);
      enter(code, name);
    },
  });
  session.start();
}

async function start() {
  byId("loading").remove();
  await loadTexts();
  byId("enter-form").addEventListener("submit", (event) => {
    event.preventDefault();
    submitted();
  });
  addEventListener("hashchange", () => location.reload());
  document.body.classList.toggle("embedded", parentOrigin !== "");
  const { code, watch, token } = invitation();
  const name = givenName || recall("name");
  // A reload of the page returns to the seat without a question, as does an address with a name.
  const known = givenName || (!watch && seatToken(seatKey(code, token)));
  if (code && name && known) enter(code, name);
  else showForm();
}

start().catch((error) => {
  document.body.append(element("p", { role: "alert" }, String(error)));
});
