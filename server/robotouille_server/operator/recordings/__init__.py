"""Recordings for operators: heads for lists, downloads, archives, replays and transcripts."""

from robotouille_server.operator.recordings.stored_recordings import StoredRecordings

__all__ = ["StoredRecordings"]
