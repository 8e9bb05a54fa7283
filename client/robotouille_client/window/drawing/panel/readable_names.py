"""Names that no font of this machine can write."""

from __future__ import annotations

from dataclasses import replace

from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.view import View

__all__ = ["with_readable_names"]


def with_readable_names(view: View, text: Typesetter) -> View:
    """A view in which those whose name cannot be read are called what their player is called."""
    if all(seat.name.isascii() for seat in view.seats):
        return view
    called = {
        seat.name: seat.player for seat in view.seats if seat.name and not text.reads(seat.name)
    }
    if not called:
        return view
    return replace(
        view,
        seats=tuple(replace(seat, name=called.get(seat.name, seat.name)) for seat in view.seats),
        chat=tuple((called.get(name, name), said) for name, said in view.chat),
    )
