// The form that opens episodes, and the table of their links.

import { get, post } from "./api.js";
import { ask, toast } from "./dialogs.js";
import { button, h, saveAs, setAttribute, setText, taskTitle } from "./dom.js";
import { asCSV, keepPageAddress, linkRows, pageAddress } from "./links.js";

const DAY = 86_400;
const CLOCKS = [["realtime", "real time"], ["lockstep", "lockstep: a step when all have decided"], ["turn", "turns"]];
const ABSENCES = [["", "as the server is set"], ["wait", "wait: the game goes on without them"], ["pause", "pause the game"], ["bot", "a substitute plays"], ["end", "end the game"]];
const OPEN_FOR = [[3600, "an hour"], [DAY, "a day"], [7 * DAY, "7 days"], [30 * DAY, "30 days"]];

let fields = 0;

function select(options, chosen) {
  return h("select", {}, ...options.map(([value, words]) => h("option", { value, selected: value === chosen }, words)));
}

// A control with its label, a hint, and room for what is wrong with it.
function field(label, control, hint = "") {
  const id = `field-${(fields += 1)}`;
  const fault = h("span", { class: "fault", id: `${id}-fault` });
  control.id = id;
  control.setAttribute("aria-describedby", `${id}-hint ${id}-fault`);
  const root = h("div", { class: "field" }, h("label", { for: id }, label), control,
    h("span", { class: "hint", id: `${id}-hint` }, hint), fault);
  return {
    root, control,
    fail(words) {
      setText(fault, words);
      setAttribute(control, "aria-invalid", String(Boolean(words)));
    },
  };
}

const whole = (props) => h("input", { type: "number", inputmode: "numeric", step: 1, ...props });

class FieldFault extends Error {
  constructor(field, message) {
    super(message);
    this.field = field;
  }
}

// Labels from `condition=novice, pair=p1`.
export function labelsOf(text) {
  const parts = text.split(",").map((part) => part.trim()).filter(Boolean);
  return Object.fromEntries(parts.map((part) => {
    const [name, ...value] = part.split("=");
    if (!name.trim() || !value.join("=").trim()) throw new FieldFault("labels", `${part} is not a label; write NAME=VALUE`);
    return [name.trim(), value.join("=").trim()];
  }));
}

const seatWords = ({ seats, shift }) => `${seats.join(", ")} ${seats.join() === "1" ? "seat" : "seats"}${shift ? ", shift" : ""}`;

// Names of the tasks by their titles, as the lists of episodes and recordings show them.
function namesByTitle(tasks) {
  const names = new Map();
  for (const { name } of tasks) {
    const title = taskTitle(name).title.toLowerCase();
    names.set(title, [...(names.get(title) ?? []), name]);
  }
  return names;
}

class Form {
  constructor(server, { tasks, skills }) {
    this.server = server;
    this.tasks = new Map(tasks.map((task) => [task.name, task]));
    this.names = namesByTitle(tasks);
    const names = h("datalist", { id: "task-names" }, ...tasks.map((task) => h("option", { value: task.name },
      `${taskTitle(task.name).title}: ${seatWords(task)}`)));
    this.fields = {
      task: field("Task", h("input", { list: "task-names", required: true, maxlength: 200, autocomplete: "off", spellcheck: "false" }), "Type to search."),
      seats: field("Seats", whole({ min: 1, max: 16 })),
      count: field("Episodes", whole({ min: 1, max: 100, value: 1, required: true })),
      clock: field("Clock", select(CLOCKS, "realtime")),
      step_rate: field("Steps per second", h("input", { type: "number", min: 0.01, step: "any", placeholder: "as the server is set" })),
      absence: field("When a player is away", select(ABSENCES, "")),
      bots: field("Seats for bots", whole({ min: 0, max: 16, value: 0 }), "The last seats. You get a command for each bot."),
      skill: field("Skill of bots", select([["", "partner with people, else expert"], ...skills.map((name) => [name, name])], "")),
      labels: field("Labels", h("input", { maxlength: 500, placeholder: "condition=novice, pair=p1", autocomplete: "off" }), "Players do not see them."),
      open_for: field("Unused links are valid for", select(OPEN_FOR, 7 * DAY)),
      page: field("Address of the game for players", h("input", { type: "url", value: pageAddress(server), required: true, spellcheck: "false" }), "Links begin with it."),
    };
    this.send = h("button", { type: "submit", class: "button primary" }, "Open");
    this.status = h("p", { class: "fault", role: "alert" });
    const { task, clock } = this.fields;
    task.control.addEventListener("input", () => this.showSeats());
    clock.control.addEventListener("change", () => this.showRate());
    this.root = h("form", { class: "opening", novalidate: true }, h("h2", {}, "Open episodes"), names,
      h("div", { class: "grid" }, ...Object.values(this.fields).map(({ root }) => root)), this.status,
      h("div", { class: "choices" },
        h("button", { type: "button", class: "button", onclick: () => this.root.closest("dialog").close() }, "Cancel"), this.send));
    this.showSeats();
    this.showRate();
  }

  value(name) {
    return this.fields[name].control.value.trim();
  }

  // Names of the tasks that the operator may mean: several if they share the entered title.
  taskNames() {
    const entered = this.value("task");
    return (!this.tasks.has(entered) && this.names.get(entered.toLowerCase())) || [entered];
  }

  showSeats() {
    const [name, ...others] = this.taskNames();
    const task = others.length ? null : this.tasks.get(name);
    const { seats } = this.fields;
    seats.control.placeholder = task ? String(task.seats[0]) : "as usual";
    setText(seats.root.querySelector(".hint"), task ? `Possible: ${task.seats.join(", ")}` : "");
  }

  showRate() {
    this.fields.step_rate.root.hidden = this.value("clock") !== "realtime";
  }

  number(name) {
    const { control } = this.fields[name];
    if (!control.checkValidity()) throw new FieldFault(name, control.validationMessage);
    return control.value === "" ? null : Number(control.value);
  }

  // What the operator wants; raises FieldFault for what only this page can check.
  order() {
    const [task, ...others] = this.taskNames();
    if (!task) throw new FieldFault("task", "Choose a task.");
    if (others.length) throw new FieldFault("task", `Several tasks have this title. Choose one of ${[task, ...others].join(", ")}.`);
    const seats = this.number("seats");
    const create = { task, clock: this.value("clock"), tokens: true, open_for: Number(this.value("open_for")) };
    if (seats !== null) create.seats = seats;
    const rate = create.clock === "realtime" ? this.number("step_rate") : null;
    if (rate !== null) create.step_rate = rate;
    if (this.value("absence")) create.absence = this.value("absence");
    create.labels = labelsOf(this.value("labels"));
    const count = this.number("count");
    const most = seats ?? this.tasks.get(create.task)?.seats[0] ?? 16;
    const bots = { count: this.number("bots") ?? 0, skill: this.value("skill") };
    if (bots.count > most) throw new FieldFault("bots", `The task has ${most} ${most === 1 ? "seat" : "seats"}.`);
    if (!this.fields.page.control.checkValidity()) throw new FieldFault("page", "Enter an address such as https://kitchen.example.org/play.");
    return { count, create, bots, page: this.value("page") };
  }

  // The server's message names a command that lists the tasks; the page has its own list.
  unknownTask({ message }) {
    const [near = ""] = message.match(/did you mean [^?]*\?/) ?? [];
    const hint = near || "Type a part of its name and choose it from the list.";
    return `No task is called ${this.value("task")}. ${hint.charAt(0).toUpperCase()}${hint.slice(1)}`;
  }

  show(problem) {
    for (const each of Object.values(this.fields)) each.fail("");
    setText(this.status, "");
    if (!problem) return;
    // The server names fields as `create.labels.condition`.
    const [name] = (problem.field ?? "").replace(/^create\./, "").split(".");
    const found = this.fields[name];
    if (!found) return setText(this.status, problem.message);
    const words = problem.code === "task/unknown" ? this.unknownTask(problem) : problem.message.replace(`invalid ${problem.field}: `, "").replace(`${name}: `, "");
    found.fail(words);
    found.control.focus();
  }

  // Opens the episodes; resolves to their links, or to null after a fault, which is shown.
  async submitted() {
    this.show(null);
    this.send.disabled = true;
    try {
      const { count, create, bots, page } = this.order();
      const answer = await post("api/episodes", { count, create });
      keepPageAddress(this.server, page);
      const made = { page, server: this.server.url, create, bots };
      return new Links(answer, linkRows(answer.opened, made));
    } catch (problem) {
      this.show(problem);
      return null;
    } finally {
      this.send.disabled = false;
    }
  }
}

// The links of the new episodes. The server does not keep them, so they are shown once.
class Links {
  constructor({ opened, problem }, rows) {
    this.rows = rows;
    this.saved = false;
    const players = Object.keys(rows[0].links);
    const title = opened.length === 1 ? "An episode is open" : `${opened.length} episodes are open`;
    const head = ["Code", ...players].map((words) => h("th", { scope: "col" }, words));
    this.root = h("form", { class: "opened", method: "dialog" }, h("h2", { tabindex: "-1" }, title),
      problem ? h("p", { class: "fault", role: "alert" }, `The others are not: ${problem.message}`) : null,
      h("p", {}, "Each link is for one seat. Whoever has it can take the seat, so send it to its player only. This list is not shown again."),
      h("div", { class: "table", tabindex: "0", role: "region", "aria-label": "Links" },
        h("table", {}, h("thead", {}, h("tr", {}, ...head)), h("tbody", {}, ...rows.map((row) => this.line(row))))),
      h("div", { class: "choices" },
        button("copy", "Copy all", () => this.copy(asCSV(rows, "\t"), "all links")),
        button("save", "Save as CSV", () => this.save(), "primary"),
        h("button", { type: "submit", class: "button" }, "Close")));
  }

  line({ code, links, bots }) {
    const cells = Object.entries(links).map(([player, link]) => {
      const what = bots[player] ? `the command of the bot for ${player} in ${code}` : `the link of ${player} in ${code}`;
      return h("td", {}, h("span", { class: "secret" }, h("code", {}, bots[player] || link.slice(link.indexOf("#"))),
        button("copy", `Copy ${what}`, () => this.copy(bots[player] || link, what), "icon small")));
    });
    return h("tr", {}, h("th", { scope: "row" }, code), ...cells);
  }

  async copy(text, what) {
    try {
      await navigator.clipboard.writeText(text);
      this.saved = true;
      toast(`Copied ${what}`);
    } catch {
      toast("This browser does not allow copying. Save the CSV file.", true);
    }
  }

  save() {
    saveAs(new Blob([asCSV(this.rows, ",")], { type: "text/csv" }), "opened.csv");
    this.saved = true;
  }
}

const lose = () => ask({
  title: "Close without the links?",
  text: "You have neither saved nor copied them, and they are not shown again.",
  confirm: "Close",
  danger: true,
});

export async function openEpisodes(server) {
  let tasks;
  try {
    tasks = await get("api/tasks");
  } catch (problem) {
    return toast(problem.message, true);
  }
  const form = new Form(server, tasks);
  let links = null;
  const dialog = h("dialog", {
    class: "wide", "aria-label": "Open episodes",
    onclose: () => {
      if (!dialog.open) dialog.remove();
    },
    oncancel: (event) => {
      if (!links || links.saved) return;
      event.preventDefault();
      close();
    },
  }, form.root);
  async function close() {
    if (links.saved || (await lose()) !== null) dialog.close();
  }
  form.root.addEventListener("submit", async (event) => {
    event.preventDefault();
    links = await form.submitted();
    if (!links) return;
    links.root.addEventListener("submit", (submission) => {
      submission.preventDefault();
      close();
    });
    dialog.replaceChildren(links.root);
    // The operator may have cancelled while the server opened the episodes.
    if (!dialog.open) open();
    links.root.querySelector("h2").focus();
  });
  function open() {
    document.body.append(dialog);
    dialog.showModal();
  }
  open();
  form.fields.task.control.focus();
}
