"""Conversations for fine-tuning: what a seat's participant saw, thought and did."""

from __future__ import annotations

import json
from collections.abc import Iterator

from robotouille_data.exports.formats.recorded import Moment, Replay, replays
from robotouille_data.exports.part import Entry, Field, Part, Written
from robotouille_data.exports.request import Request

__all__ = ["write_chat"]

CHAT = Entry(
    "chat",
    "one conversation a line: an object with `messages`, in the form that is used for fine-tuning",
    (
        Field(
            "messages",
            "list of {role, content}",
            "`system` (if a text was given), then by turns `user`: the observation in words, and "
            "`assistant`: the reasoning if there is one, and the action. Actions of stand-ins, and "
            "those that were refused or lost, are not in it.",
        ),
    ),
)
LINES = Entry(
    "lines",
    "one row for each line of `chat.jsonl`",
    (
        Field("line", "biginteger", "its place in `chat.jsonl`, from 0 on"),
        Field("episode_id", "biginteger", "`episodes.id` of the catalogue"),
        Field("seat", "integer", "whose conversation it is: `seats.seat`"),
        Field("step", "integer", "the step of its first action"),
        Field("decisions", "integer", "how many actions there are in it", "actions"),
    ),
)

Message = dict[str, str]


def write_chat(part: Part) -> Iterator[Written]:
    """Write `chat.jsonl`, and `lines.jsonl` that says whose each line is."""
    part.codebook.update({entry.name: entry for entry in (CHAT, LINES)})
    chat, lines = part.folder / "chat.jsonl", part.folder / "lines.jsonl"
    count = decisions = 0
    with (
        chat.open("w", encoding="utf-8", newline="") as file,
        lines.open("w", encoding="utf-8", newline="") as table,
    ):
        names = [field.name for field in LINES.fields]
        for replay in replays(part):
            for seat, moments in _conversations(replay, part.request.per_decision):
                messages = _messages(replay.world.players[seat], moments, part.request)
                file.write(json.dumps({"messages": messages}, ensure_ascii=False) + "\n")
                row = (count, replay.episode_id, seat, moments[0].step, len(moments))
                table.write(json.dumps(dict(zip(names, row, strict=True))) + "\n")
                count += 1
                decisions += len(moments)
    yield Written("chat", part.path(chat), count)
    yield Written("lines", part.path(lines), count, {"decisions": decisions})


def _conversations(replay: Replay, per_decision: bool) -> Iterator[tuple[int, list[Moment]]]:
    """Seats with the steps in which their participants acted."""
    for seat, player in enumerate(replay.world.players):
        moments = [m for m in replay.moments if player in m.moves and m.moves[player].own]
        if per_decision:
            yield from ((seat, [moment]) for moment in moments)
        elif moments:
            yield seat, moments


def _messages(player: str, moments: list[Moment], request: Request) -> list[Message]:
    messages = [{"role": "system", "content": request.system}] if request.system else []
    for moment in moments:
        move = moment.moves[player]
        said = f"Action: {move.action.sentence}"
        if move.reasoning and request.texts:
            said = f"Reasoning: {move.reasoning}\n{said}"
        messages += [
            {"role": "user", "content": moment.before.text_view(player)},
            {"role": "assistant", "content": said},
        ]
    return messages
