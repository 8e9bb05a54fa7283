// The page: what is shown, and where it comes from.

import { announceToAll } from "./actions.js";
import { follow, get } from "./api.js";
import { setText } from "./dom.js";
import { Episodes } from "./episodes.js";
import { Recordings } from "./recordings.js";
import { Totals } from "./totals.js";
import { Watch } from "./watch.js";

const $ = (id) => document.getElementById(id);
const PAGE = 50;
const RECORDINGS_EVERY = 3000;

const view = { tab: "episodes", search: "", phase: "", offset: 0, found: 0 };

const watch = new Watch($("watch"), (episode) => {
  document.body.classList.toggle("watching", Boolean(episode));
  episodes.mark(episode);
  history.replaceState(null, "", episode ? `#${episode}` : location.pathname);
});
const show = (episode) => watch.show(episode);
const totals = new Totals($("totals"), $("faults"), $("alerts"), show);
const episodes = new Episodes($("episodes"), show);
const recordings = new Recordings($("recordings"));

// What comes in

let unfollow = () => {};

function followOverview() {
  unfollow();
  const asked = new URLSearchParams({ limit: PAGE });
  if (view.tab === "episodes") {
    asked.set("offset", view.offset);
    if (view.phase) asked.set("phase", view.phase);
    if (view.search) asked.set("search", view.search);
  }
  const filtered = Boolean(view.phase || view.search);
  unfollow = follow(`api/overview/events?${asked}`, {
    linked: (up) => {
      $("link").className = up ? "link up" : "link down";
      setText($("link"), up ? "live" : "connecting again");
    },
    told: (overview) => {
      totals.update(overview);
      $("announce").hidden = Boolean(overview.server.only);
      const counts = overview.totals.episodes;
      setText($("count-episodes"), counts.running + counts.paused + counts.waiting + counts.over);
      if (view.tab !== "episodes") return;
      episodes.update(overview, filtered);
      episodes.mark(watch.episode);
      paged(overview.found);
    },
  });
}

async function lookAtRecordings() {
  const shown = view.tab === "recordings";
  const asked = new URLSearchParams(shown ? { limit: PAGE, offset: view.offset, search: view.search } : { limit: 1 });
  try {
    const page = await get(`api/recordings?${asked}`);
    if (!view.search || !shown) setText($("count-recordings"), page.found);
    if (!shown || view.tab !== "recordings") return;
    recordings.update(page, Boolean(view.search));
    paged(page.found);
  } catch (problem) {
    recordings.fail(problem);
  }
}

// What is asked for

function paged(found) {
  view.found = found;
  const last = Math.min(found, view.offset + PAGE);
  $("pager").hidden = found <= PAGE && view.offset === 0;
  setText($("range"), `${found ? view.offset + 1 : 0}–${last} of ${found}`);
  $("previous").disabled = view.offset === 0;
  $("next").disabled = last >= found;
}

function look(changes) {
  Object.assign(view, { offset: 0 }, changes);
  for (const tab of ["episodes", "recordings"]) {
    $(tab).hidden = view.tab !== tab;
    $(`tab-${tab}`).setAttribute("aria-selected", String(view.tab === tab));
  }
  $("phase").hidden = view.tab !== "episodes";
  followOverview();
  lookAtRecordings();
}

let typing = 0;
$("search").addEventListener("input", (event) => {
  clearTimeout(typing);
  typing = setTimeout(() => look({ search: event.target.value.trim() }), 250);
});
$("phase").addEventListener("change", (event) => look({ phase: event.target.value }));
$("tab-episodes").addEventListener("click", () => look({ tab: "episodes" }));
$("tab-recordings").addEventListener("click", () => look({ tab: "recordings" }));
$("previous").addEventListener("click", () => look({ offset: Math.max(0, view.offset - PAGE) }));
$("next").addEventListener("click", () => look({ offset: view.offset + PAGE }));
$("announce").addEventListener("click", announceToAll);
addEventListener("keydown", (event) => {
  if (event.key === "Escape" && !document.querySelector("dialog[open]")) show("");
});

// Light or dark: as the system has it, until somebody chooses.

const LOOK = "robotouille-operator-look";
const dark = matchMedia("(prefers-color-scheme: dark)");
document.documentElement.dataset.look = localStorage.getItem(LOOK) ?? "";
$("theme").addEventListener("click", () => {
  const now = document.documentElement.dataset.look || (dark.matches ? "dark" : "light");
  const next = now === "dark" ? "light" : "dark";
  document.documentElement.dataset.look = next;
  localStorage.setItem(LOOK, next);
});

look({});
setInterval(lookAtRecordings, RECORDINGS_EVERY);
if (location.hash.length > 1) show(decodeURIComponent(location.hash.slice(1)));
