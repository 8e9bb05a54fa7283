"""What a viewer says in words: times, entries, who somebody is."""

from __future__ import annotations

from robotouille_client.window.replay.history.history import Entry, EntryKind, History

__all__ = ["entry_words", "name_of", "time_words"]


def time_words(milliseconds: int) -> str:
    """`24.0 s`, from a minute on `1:24`."""
    seconds = milliseconds / 1000
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def name_of(history: History, player: str, step: int) -> str:
    """What the participant of a seat is called, else the player."""
    names = {seat.player: seat.name for seat in history.seats(step)}
    return names.get(player) or player


def entry_words(entry: Entry) -> str:
    """What happened, without whose it is."""
    match entry.kind:
        case EntryKind.REJECTED:
            why = "; ".join(entry.reasons)
            return f"not done: {entry.words}" + (f" ({why})" if why else "")
        case EntryKind.SUPERSEDED:
            return f"changed its mind: {entry.words}"
        case EntryKind.SAID:
            return f"“{entry.words}”"
        case EntryKind.REASONING:
            return f"thinks: {entry.words}"
        case EntryKind.ANNOUNCED:
            return f"the operator: {entry.words}"
    return entry.words
