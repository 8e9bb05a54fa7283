// The page that shows a recording: loads its data, and a codebook if the reader has chosen one.

import { getPacked, post } from "./api.js";
import { h } from "./dom.js";
import replay from "./replay/bundle.js";

const CODEBOOK = "robotouille-operator-codebook";

function fail(words) {
  const message = document.getElementById("message");
  message.hidden = false;
  message.textContent = words;
}

// The choice of a codebook, in the bar of the page.
function chooser() {
  const fault = h("p", { role: "alert" });
  const input = h("input", {
    type: "file", accept: "application/json,.json",
    onchange: async () => {
      const [file] = input.files;
      try {
        sessionStorage.setItem(CODEBOOK, JSON.stringify(await post("api/codebook", JSON.parse(await file.text()))));
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
