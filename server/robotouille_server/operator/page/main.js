// The page: connects the parts with the server and handles tabs, search and paging.

import { announceToAll } from "./actions.js";
import { follow, get } from "./api.js";
import { setText } from "./dom.js";
import { Episodes } from "./episodes.js";
import { Nodes } from "./nodes.js";
import { openEpisodes } from "./open.js";
import { Recordings } from "./recordings.js";
import { Totals } from "./totals.js";
import { Watch } from "./watch.js";

const $ = (id) => document.getElementById(id);
const PAGE = 50;
const RECORDINGS_EVERY = 3000;

const view = { tab: "episodes", search: "", phase: "", offset: 0, found: 0, server: { page: "" } };

const watch = new Watch($("watch"), (episode) => {
  document.body.classList.toggle("watching", Boolean(episode));
  episodes.mark(episode);
  history.replaceState(null, "", episode ? `#${episode}` : location.pathname);
}, () => view.server);
const show = (episode) => watch.show(episode);
const totals = new Totals($("totals"), $("faults"), $("alerts"), show);
const nodes = new Nodes($("nodes"));
const episodes = new Episodes($("episodes"), show);
const recordings = new Recordings($("recordings"));

// Data from the server

let unfollow = () => {};

function followOverview() {
  unfollow();
  const query = new URLSearchParams({ limit: PAGE });
  if (view.tab === "episodes") {
    query.set("offset", view.offset);
    if (view.phase) query.set("phase", view.phase);
    if (view.search) query.set("search", view.search);
  }
  const filtered = Boolean(view.phase || view.search);
  unfollow = follow(`api/overview/events?${query}`, {
    linked: (up) => {
      $("link").className = up ? "link up" : "link down";
      setText($("link"), up ? "live" : "reconnecting");
    },
    received: (overview) => {
      totals.update(overview);
      nodes.update(overview);
      view.server = overview.server;
      $("announce").hidden = $("open").hidden = Boolean(overview.server.only);
      const counts = overview.totals.episodes;
      setText($("count-episodes"), counts.running + counts.paused + counts.waiting + counts.ended);
      if (view.tab !== "episodes") return;
      episodes.update(overview, filtered);
      episodes.mark(watch.episode);
      updatePager(overview.found);
    },
  });
}

async function refreshRecordings() {
  const shown = view.tab === "recordings";
  const query = new URLSearchParams(shown ? { limit: PAGE, offset: view.offset, search: view.search } : { limit: 1 });
  try {
    const page = await get(`api/recordings?${query}`);
    if (!view.search || !shown) setText($("count-recordings"), page.found);
    if (!shown || view.tab !== "recordings") return;
    recordings.update(page, view.search);
    updatePager(page.found);
  } catch (problem) {
    recordings.fail(problem);
  }
}

// Filters and paging

function updatePager(found) {
  view.found = found;
  const last = Math.min(found, view.offset + PAGE);
  $("pager").hidden = found <= PAGE && view.offset === 0;
  setText($("range"), `${found ? view.offset + 1 : 0}–${last} of ${found}`);
  $("previous").disabled = view.offset === 0;
  $("next").disabled = last >= found;
}

function showList(changes) {
  Object.assign(view, { offset: 0 }, changes);
  for (const tab of ["episodes", "recordings"]) {
    $(tab).hidden = view.tab !== tab;
    $(`tab-${tab}`).setAttribute("aria-selected", String(view.tab === tab));
  }
  $("phase").hidden = view.tab !== "episodes";
  followOverview();
  refreshRecordings();
}

let typing = 0;
$("search").addEventListener("input", (event) => {
  clearTimeout(typing);
  typing = setTimeout(() => showList({ search: event.target.value.trim() }), 250);
});
$("phase").addEventListener("change", (event) => showList({ phase: event.target.value }));
$("tab-episodes").addEventListener("click", () => showList({ tab: "episodes" }));
$("tab-recordings").addEventListener("click", () => showList({ tab: "recordings" }));
$("previous").addEventListener("click", () => showList({ offset: Math.max(0, view.offset - PAGE) }));
$("next").addEventListener("click", () => showList({ offset: view.offset + PAGE }));
$("announce").addEventListener("click", announceToAll);
$("open").addEventListener("click", () => openEpisodes(view.server));
addEventListener("keydown", (event) => {
  if (event.key === "Escape" && !document.querySelector("dialog[open]")) show("");
});

// Colours: those of the system until the operator chooses.

const THEME = "robotouille-operator-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");
document.documentElement.dataset.theme = localStorage.getItem(THEME) ?? "";
$("theme").addEventListener("click", () => {
  const now = document.documentElement.dataset.theme || (dark.matches ? "dark" : "light");
  const next = now === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = next;
  localStorage.setItem(THEME, next);
});

showList({});
setInterval(refreshRecordings, RECORDINGS_EVERY);
if (location.hash.length > 1) show(decodeURIComponent(location.hash.slice(1)));
