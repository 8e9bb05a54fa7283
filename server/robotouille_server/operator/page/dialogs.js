// Dialogs and short notifications.

import { h } from "./dom.js";

// Resolves to the text of the field ("" without a field), or to null if the dialog is cancelled.
export function ask({ title, text = "", field = null, confirm, danger = false, cancel = true }) {
  return new Promise((resolve) => {
    const input = field && h(field.area ? "textarea" : "input", {
      name: "answer", maxlength: field.max, placeholder: field.placeholder ?? "", required: field.required,
      type: field.area ? null : (field.type ?? "text"), rows: field.area ? 3 : null, autocomplete: "off",
    });
    const finish = (answer) => {
      dialog.close();
      dialog.remove();
      resolve(answer);
    };
    const form = h("form", {
      onsubmit: (event) => {
        event.preventDefault();
        finish(input ? input.value.trim() : "");
      },
    },
      h("h2", {}, title),
      text ? h("p", {}, text) : null,
      field ? h("label", {}, h("span", {}, field.label), input) : null,
      h("div", { class: "choices" },
        cancel ? h("button", { type: "button", class: "button", onclick: () => finish(null) }, "Cancel") : null,
        h("button", { type: "submit", class: `button ${danger ? "danger" : "primary"}` }, confirm)),
    );
    const dialog = h("dialog", {
      oncancel: (event) => {
        event.preventDefault();
        if (cancel) finish(null);
      },
    }, form);
    document.body.append(dialog);
    dialog.showModal();
    (input ?? form.querySelector("[type=submit]")).focus();
  });
}

export const askToken = (fault) => ask({
  title: "Operator token",
  text: fault || "This page needs an operator token. Create one with robotouille-token.",
  field: { label: "Token", type: "password", max: 2000, required: true },
  confirm: "Sign in",
  cancel: false,
});

export function toast(words, bad = false) {
  const note = h("p", { class: bad ? "bad" : "" }, words);
  const place = document.getElementById("toasts");
  place.append(note);
  while (place.children.length > 4) place.firstChild.remove();
  setTimeout(() => note.remove(), bad ? 10_000 : 4_000);
}

// Run an action, show its result or its error, and return its answer.
export async function attempt(action) {
  try {
    const answer = await action();
    if (answer?.done) toast(answer.done.charAt(0).toUpperCase() + answer.done.slice(1));
    return answer;
  } catch (problem) {
    toast(problem.message, true);
  }
}
