// The page that shows a recording: loads its data, and a codebook if the reader has chosen one.

import { getPacked } from "./api.js";
import { h } from "./dom.js";
import replay from "./replay/bundle.js";

const CODEBOOK = "robotouille-operator-codebook";
const RESERVED = " ,.+-";

function fail(words) {
  const message = document.getElementById("message");
  message.hidden = false;
  message.textContent = words;
}

// A codebook as `robotouille replay page --codebook` reads it.
function codebookOf(text) {
  const { labels } = JSON.parse(text);
  const fits = (value, most) => typeof value === "string" && value.length > 0 && value.length <= most;
  const right = Array.isArray(labels) && labels.length > 0 && labels.length <= 40
    && labels.every(({ id, title, key }) => fits(id, 60) && fits(title, 200) && fits(key, 1) && !RESERVED.includes(key));
  const distinct = (field) => new Set(labels.map((label) => label[field].toLowerCase())).size === labels.length;
  if (!right || !distinct("id") || !distinct("key")) throw new Error("it needs `labels` with distinct `id`, `title` and `key`");
  return { labels: labels.map(({ id, title, key }) => ({ id, title, key: key.toLowerCase() })) };
}

// The choice of a codebook, in the bar of the page.
function chooser() {
  const fault = h("p", { role: "alert" });
  const input = h("input", {
    type: "file", accept: "application/json,.json",
    onchange: async () => {
      const [file] = input.files;
      try {
        sessionStorage.setItem(CODEBOOK, JSON.stringify(codebookOf(await file.text())));
        location.reload();
      } catch (error) {
        fault.textContent = `${file.name} is not a codebook: ${error.message}`;
        input.value = "";
      }
    },
  });
  return [fault, h("button", { type: "button", onclick: () => input.click() }, "Codebook …")];
}

async function start() {
  try {
    const name = decodeURIComponent(location.hash.slice(1));
    if (!name) return fail("The address names no recording. Open a replay from the operator page.");
    const data = await getPacked(`api/recordings/${encodeURIComponent(name)}/replay`);
    const codebook = sessionStorage.getItem(CODEBOOK);
    if (codebook) data.codebook = JSON.parse(codebook);
    await replay.start(data);
    const help = document.getElementById("help-button");
    const tools = h("div", { class: "tools" }, ...chooser());
    help.replaceWith(tools);
    tools.append(help);
  } catch (error) {
    fail(`The recording cannot be shown: ${error.message}`);
  }
}

addEventListener("hashchange", () => location.reload());
start();
