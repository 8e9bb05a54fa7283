// Texts of the page for recordings, besides those of the page for players.

import english from "../texts/en.js";
import german from "../texts/de.js";
import { useTexts } from "../play/texts.js";

/** @type {Record<string, string>} */
const ENGLISH = {
  play: "Play", pause: "Pause", first: "Beginning", last: "End", back1: "One step back",
  on1: "One step on", mark1: "Previous event", mark2: "Next event", speed: "Speed",
  inStep: "By step", inTime: "By time", sync: "Two recordings", recording: "Recording {number}",
  step: "Step {step} of {last}", lane: "Timeline", log: "Events", paused: "Paused for {seconds} s",
  pausedOpen: "Paused until the recording ends", restarted: "The server was restarted",
  operator: "The operator: {text}", someone: "A spectator", hidden: "(text left out)",
  thought: "{name} thinks: {text}", noted: "{name} notes {text}",
  wasRejected: "{name}: {action}. Rejected: {reason}", wasLost: "{name}: {action}. Too late: {reason}",
  lost: "{name} was away too long", removed: "{name} was removed",
  bySubstitute: "{what}; a bot stands in", nobody: "nobody", toGo: "steps to go",
  toGoIs: "{steps} steps to go", toGoRange: "{least} to {most} steps to go",
  toGoMost: "at most {most} steps to go", toGoLeast: "at least {least} steps to go",
  toGoNever: "the goal is out of reach", damaged: "The recording ends here: {fault}",
  noEnd: "The recording has no end", anonymous: "Names and texts were left out",
  a: "acts", b: "busy", w: "waits", i: "idle", x: "away", s: "a bot stands in", "?": "",
  "hold operator": "by the operator", "hold player": "by the player",
  "hold storage": "the recording could not be written", "hold restart": "the server was restarted",
  "hold absence": "a player was away", "hold deserted": "everybody was away",
  signs: "Signs", said: "chat", rejectedSign: "rejected", pauseSign: "pause", restartSign: "restart",
  announcedSign: "announcement", thoughtSign: "reasoning", endSign: "the end",
  keySpace: "play or pause", keyArrows: "one step; with Shift ten", keyEvents: "previous, next event",
  keySpeed: "slower, faster", keyEnds: "beginning, end", points: "{points} points",
};
/** @type {Record<string, string>} */
const GERMAN = {
  play: "Abspielen", pause: "Anhalten", first: "Anfang", last: "Ende",
  back1: "Ein Schritt zurück", on1: "Ein Schritt weiter", mark1: "Voriges Ereignis",
  mark2: "Nächstes Ereignis", speed: "Tempo", inStep: "Nach Schritten", inTime: "Nach der Zeit",
  sync: "Zwei Aufnahmen", recording: "Aufnahme {number}", step: "Schritt {step} von {last}",
  lane: "Zeitleiste", log: "Ereignisse", paused: "{seconds} s lang angehalten",
  pausedOpen: "Angehalten bis zum Ende der Aufnahme", restarted: "Der Server wurde neu gestartet",
  operator: "Die Leitung: {text}", someone: "Jemand im Publikum", hidden: "(Text weggelassen)",
  thought: "{name} denkt: {text}", noted: "{name} notiert {text}",
  wasRejected: "{name}: {action}. Abgelehnt: {reason}",
  wasLost: "{name}: {action}. Zu spät: {reason}",
  lost: "{name} war zu lange weg", removed: "{name} wurde entfernt",
  bySubstitute: "{what}; ein Bot springt ein", nobody: "niemand", toGo: "Schritte bis zum Ziel",
  toGoIs: "{steps} Schritte bis zum Ziel", toGoRange: "{least} bis {most} Schritte bis zum Ziel",
  toGoMost: "höchstens {most} Schritte bis zum Ziel",
  toGoLeast: "mindestens {least} Schritte bis zum Ziel", toGoNever: "das Ziel ist unerreichbar",
  damaged: "Die Aufnahme endet hier: {fault}", noEnd: "Die Aufnahme hat kein Ende",
  anonymous: "Namen und Texte wurden weggelassen",
  a: "handelt", b: "beschäftigt", w: "wartet", i: "untätig", x: "weg", s: "ein Bot springt ein",
  "hold operator": "durch die Leitung", "hold player": "durch die Person am Spiel",
  "hold storage": "die Aufnahme ließ sich nicht schreiben",
  "hold restart": "der Server wurde neu gestartet", "hold absence": "jemand war weg",
  "hold deserted": "alle waren weg", signs: "Zeichen", said: "Chat", rejectedSign: "abgelehnt",
  pauseSign: "Pause", restartSign: "Neustart", announcedSign: "Ansage",
  thoughtSign: "Überlegung", endSign: "Ende", keySpace: "abspielen oder anhalten",
  keyArrows: "ein Schritt; mit Umschalt zehn", keyEvents: "voriges, nächstes Ereignis",
  keySpeed: "langsamer, schneller", keyEnds: "Anfang, Ende", points: "{points} Punkte",
};

/** Use the texts of the language that the address or the browser asks for. */
export function chooseTexts() {
  const asked = new URLSearchParams(location.search).get("lang");
  const wanted = [asked, ...navigator.languages].map((name) => (name ?? "").slice(0, 2));
  const language = wanted.find((name) => name === "de" || name === "en") ?? "en";
  if (language === "de") useTexts("de", { ...german, ...GERMAN });
  else useTexts("en", { ...english, ...ENGLISH });
}
