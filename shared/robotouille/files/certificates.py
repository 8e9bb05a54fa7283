"""Files with certificate authorities."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from robotouille.errors import RobotouilleError
from robotouille.files.reading import open_regular

if TYPE_CHECKING:
    import ssl


def client_context(authorities: Path | None, option: str) -> ssl.SSLContext:
    """Return a TLS context for connections to a server.

    Args:
        authorities: A PEM file with the only trusted authorities. None means the system's.
        option: The option that names the file, for errors.

    Raises:
        RobotouilleError: The file contains no certificate, or cannot be read.
    """
    import ssl  # It imports sockets, which other users of the core do not need.

    try:
        if authorities is not None:
            # OpenSSL would wait for ever at a named pipe.
            open_regular(authorities).close()
        # OpenSSL reads the file itself: with an empty text instead of a path, Python would trust
        # the system's authorities, and it refuses comments that are not ASCII.
        return ssl.create_default_context(cafile=authorities)
    except ssl.SSLError:
        raise RobotouilleError(f"{option}: {authorities} is not a certificate in PEM") from None
    except OSError as error:
        raise RobotouilleError(f"{option}: {authorities}: {error.strerror}") from None
