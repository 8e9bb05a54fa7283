"""What a kitchen looks like, from the server, over the connection on which one plays.

Nothing of it is trusted: sizes, digests and schemas are checked, pictures are kept without all that
is not needed to draw them, and their names are those that a rendering may have.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
from pathlib import Path

from pydantic import ValidationError

from robotouille.domain.pictures import (
    MAX_PICTURE_BYTES,
    PictureError,
    picture_digest,
    plain_picture,
)
from robotouille.domain.rendering import RenderingFile
from robotouille.domain.schema import InputFile
from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.program import printable, tell
from robotouille.protocol import messages
from robotouille_client.client import Client
from robotouille_client.window.pictures.kitchen_look import KitchenLook

__all__ = ["fetch_look"]

MAX_PICTURES = 500
WAIT_SECONDS = 5.0
"""For the rendering: a game is not kept waiting for how it looks."""
AGAIN_SECONDS = 1.0
MAX_TRIES = 10


async def fetch_look(client: Client, folder: Path) -> KitchenLook | None:
    """What the kitchen that one is in looks like; None where it is a shipped one, or the server
    cannot tell. Pictures are written to a folder; one that is not as it should be is left out."""
    try:
        told = await asyncio.wait_for(client.rendering(), WAIT_SECONDS)
        if told.rendering is None:
            return None
        rendering = RenderingFile.model_validate(told.rendering)
        bindings = InputFile.model_validate(told.bindings or {})
    except ValidationError as error:
        tell(f"the kitchen's rendering cannot be used: {error.error_count()} faults", err=True)
        return None
    except (RobotouilleError, TimeoutError):
        return None
    wanted = {name: told.pictures[name] for name in rendering.files() if name in told.pictures}
    for name, digest in sorted(wanted.items())[:MAX_PICTURES]:
        try:
            content = _checked(name, await _asked(client, digest), digest)
        except RobotouilleError as error:
            tell(printable(f"picture {name}: {error}"), err=True)
            continue
        await asyncio.to_thread((folder / name).write_bytes, content)
    return KitchenLook(rendering, bindings, folder)


async def _asked(client: Client, digest: str) -> messages.Picture:
    """A picture; whoever asks for many at once has to wait in between."""
    for _ in range(MAX_TRIES):
        try:
            return await client.picture(digest)
        except ProtocolError as error:
            if error.code != "rate/limited":
                raise
            await asyncio.sleep(AGAIN_SECONDS)
    raise PictureError("the server is too busy to send it")


def _checked(name: str, picture: messages.Picture, digest: str) -> bytes:
    if len(picture.data) > MAX_PICTURE_BYTES * 4 // 3 + 4:
        raise PictureError("is too large")
    try:
        content = base64.b64decode(picture.data, validate=True)
    except (binascii.Error, ValueError):
        raise PictureError("is no Base64") from None
    if picture_digest(content) != digest:
        raise PictureError("is not the one that was asked for")
    return plain_picture(name, content)
