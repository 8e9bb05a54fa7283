"""Options of `robotouille data watch` for the recordings of a cluster.

Libraries of extras are imported when a command runs, because this module has options.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Annotated

import typer

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.terminal import printable, tell
from robotouille_client.console.progress import progress_bar

NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")


@dataclass(frozen=True)
class ClusterOptions:
    """Flags that name a cluster and the folder for its recordings."""

    cluster: Annotated[
        str,
        typer.Option(
            help="NATS servers of a cluster, as nats://[USER@]HOST[:PORT],… or tls://…, whose "
            "recordings are copied and indexed instead of folders."
        ),
    ] = ""
    into: Annotated[
        Path | None,
        typer.Option(
            help="Folder for recordings of the cluster. Default: NAME_recordings, next to an "
            "SQLite catalogue or in the current folder."
        ),
    ] = None
    cluster_name: Annotated[str, typer.Option(help="Name of the cluster.")] = "robotouille"
    cluster_password_file: Annotated[
        Path | None, typer.Option(help="File with the password of the NATS user.")
    ] = None
    cluster_ca: Annotated[
        Path | None,
        typer.Option(
            help="Certificate authority of the NATS servers (PEM). Default: the system's "
            "authorities."
        ),
    ] = None
    cluster_credentials: Annotated[
        Path | None, typer.Option(help="Credentials file for NATS, as nsc makes it.")
    ] = None

    def folder(self, database: str | None) -> Path:
        """Return the folder for recordings.

        Raises:
            RobotouilleError: The name of the cluster is invalid.
        """
        from robotouille_data.database import database_url

        if not NAME.fullmatch(self.cluster_name):
            raise RobotouilleError(
                f"--cluster-name {self.cluster_name}: expected up to 32 letters, digits, - and _"
            )
        if self.into is not None:
            return self.into
        near = Path()
        if database is not None and (url := database_url(database, near)).database:
            near = Path(url.database).parent if url.drivername == "sqlite" else near
        return near / f"{self.cluster_name}_recordings"


def watched_folders(
    folders: list[Path], options: ClusterOptions, database: str | None
) -> list[Path]:
    """Return the folders to watch: those given, or the one for the recordings of a cluster.

    Raises:
        RobotouilleError: Both or neither are given.
    """
    if options.cluster and folders:
        raise RobotouilleError("--cluster: give either folders or a cluster")
    if not options.cluster and not folders:
        raise RobotouilleError("give folders of recordings, or a cluster with --cluster")
    return [options.folder(database)] if options.cluster else folders


def fetching(options: ClusterOptions, folder: Path, stop: Event) -> Callable[[], None]:
    """Return a function that copies new recordings of a cluster, and reports what it did.

    The function raises UnavailableError if NATS is unavailable.

    Raises:
        RobotouilleError: An option is invalid, or the extra `cluster` is missing.
        OSError: The folder cannot be created.
    """
    from robotouille_data.database import UnavailableError

    try:
        from robotouille_data.cluster_recordings import ClusterRecordings
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "nats":
            raise
        raise MissingExtraError("--cluster", "cluster") from None
    from robotouille.nats.address import nats_address

    address = nats_address(
        options.cluster,
        options.cluster_name,
        password_file=options.cluster_password_file,
        ca=options.cluster_ca,
        credentials=options.cluster_credentials,
    )
    # The NATS library makes asyncio warn at the end of each encrypted connection, and leaves tasks
    # that have failed. The command reports failures itself.
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)
    folder.mkdir(parents=True, exist_ok=True)
    recordings = ClusterRecordings(address, folder)
    lost = False

    def fetch() -> None:
        nonlocal lost
        try:
            found = recordings.fetch(stop, lambda: progress_bar("copied"))
        except UnavailableError:
            lost = True
            raise
        if lost:
            tell("connected to NATS again", err=True)
        lost = False
        for name, fault in found.faults.items():
            tell(printable(f"object {name}: {fault}"), err=True)
        if found.files:
            tell(f"copied {found.files}")

    return fetch
