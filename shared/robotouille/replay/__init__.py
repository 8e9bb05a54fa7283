"""Recordings of episodes: written, read, verified and exported.

`replay.restore` makes an episode of one, which goes on where the recording ends.
"""

from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording, Verification, read_recording, recording_of

__all__ = ["Recorder", "Recording", "Verification", "header", "read_recording", "recording_of"]
