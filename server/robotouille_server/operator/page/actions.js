// Actions of an operator on episodes.

import { post } from "./api.js";
import { ask, attempt } from "./dialogs.js";

const path = (row, what) => `api/episodes/${row.episode}/${what}`;

export const isPausedByOperator = (row) => row.pause?.reason === "operator";

export const pauseOrResume = (row) => attempt(() => post(path(row, isPausedByOperator(row) ? "resume" : "pause")));

export async function end(row) {
  const reason = await ask({
    title: `End ${row.code}?`,
    text: "The game ends for everyone in the episode. The recording is kept.",
    field: { label: "Reason (shown to participants and recorded)", max: 200 },
    confirm: "End the episode",
    danger: true,
  });
  if (reason !== null) await attempt(() => post(path(row, "end"), { reason }));
}

export async function kick(row, who) {
  const reason = await ask({
    title: `Remove ${who.name}?`,
    text: who.player
      ? `The seat ${who.player} becomes free.`
      : "They stop watching this episode.",
    field: { label: "Reason (shown to them)", max: 200 },
    confirm: "Remove",
    danger: true,
  });
  if (reason !== null) await attempt(() => post(path(row, "kick"), { session: who.session, reason }));
}

export const mute = (row, who) => attempt(() => post(path(row, "mute"), { session: who.session, muted: !who.muted }));

// Resolves to the link, or to undefined after an error.
export const spectatorLink = (row) => attempt(() => post(path(row, "spectator_link")));

export const announce = (row, text) => attempt(() => post(path(row, "announce"), { text }));

export async function announceToAll() {
  const text = await ask({
    title: "Announce to all",
    text: "Everyone in all episodes sees this.",
    field: { label: "Text", area: true, max: 500, required: true },
    confirm: "Announce",
  });
  if (text) await attempt(() => post("api/announce", { text }));
}
