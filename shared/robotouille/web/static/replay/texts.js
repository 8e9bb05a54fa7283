// Choice of the reader's language. Both languages are part of the page.

import german from "../texts/de.js";
import english from "../texts/en.js";
import germanReplay from "../texts/replay_de.js";
import englishReplay from "../texts/replay_en.js";
import { useTexts, wantedLanguage } from "../play/texts.js";

/** Use the texts of the language that the address or the browser asks for. */
export function chooseTexts() {
  if (wantedLanguage() === "de") useTexts("de", { ...german, ...germanReplay });
  else useTexts("en", { ...english, ...englishReplay });
}
