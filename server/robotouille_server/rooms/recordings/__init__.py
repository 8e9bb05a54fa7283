"""Recordings on disk: written before anything is published, and taken up after a restart."""

from robotouille_server.rooms.recordings.archive import ArchivedEpisode
from robotouille_server.rooms.recordings.journal import CLOSED, Journal, file_name
from robotouille_server.rooms.recordings.recovery import Recovery
from robotouille_server.rooms.recordings.storage import Folder, Storage

__all__ = [
    "CLOSED",
    "ArchivedEpisode",
    "Folder",
    "Journal",
    "Recovery",
    "Storage",
    "file_name",
]
