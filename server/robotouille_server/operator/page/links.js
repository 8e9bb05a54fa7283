// Links and commands of the seats of new episodes, and their CSV.

const PAGE = "robotouille-operator-page";

// Address of the page for players. Behind a proxy, only the operator knows it.
export const pageAddress = (server) => localStorage.getItem(PAGE) || server.page;
export function keepPageAddress(server, address) {
  // The server's own address changes with its port.
  if (address === server.page) localStorage.removeItem(PAGE);
  else localStorage.setItem(PAGE, address);
}

export const spectatorAddress = (server, token) => `${new URL("watch", pageAddress(server).replace(/\/$/, ""))}#${token}`;

// A bot's command; all parts come from the server and need no quotes.
function command(server, code, token, skill) {
  return ["robotouille-bot planner", skill && `--skill ${skill}`, `--url ${server}`, `--episode ${code}`, `--token ${token}`].filter(Boolean).join(" ");
}

// One row for each episode. The last seats are for bots.
export function linkRows(opened, { page, server, create: { task, labels }, bots: { count, skill } }) {
  return opened.map(({ code, episode, links }) => {
    const players = Object.keys(links);
    const robots = players.slice(Math.max(0, players.length - count));
    const of = (names, value) => Object.fromEntries(names.map((player) => [player, value(links[player])]));
    return {
      code, episode, task, labels,
      links: of(players, (token) => `${page}#${token}`),
      bots: count ? of(robots, (token) => command(server, code, token, skill)) : {},
    };
  });
}

// A spreadsheet would run a label such as `=A1` as a formula.
const cell = (text) => (/^[=+\-@\t\r]/.test(text) ? `'${text}` : text);
// In some languages, spreadsheets separate cells by semicolons.
const quoted = (text, mark) => (/["\r\n;]/.test(text) || text.includes(mark) ? `"${text.replaceAll('"', '""')}"` : text);

function columns({ code, episode, task, labels, links, bots }) {
  const named = (group, values) => Object.entries(values).map(([name, value]) => [`${group}.${name}`, value]);
  const people = Object.entries(links).filter(([player]) => !bots[player]);
  return [["task", task], ...named("label", labels), ["code", code], ["episode", episode],
    ...named("link", Object.fromEntries(people)), ...named("bot", bots)];
}

// The table with the columns of `robotouille episodes open`, and commands of bots.
export function asCSV(rows, mark) {
  const table = rows.map(columns);
  const lines = [table[0].map(([name]) => name), ...table.map((row) => row.map(([, value]) => value))];
  return lines.map((line) => `${line.map((text) => quoted(cell(text), mark)).join(mark)}\n`).join("");
}
