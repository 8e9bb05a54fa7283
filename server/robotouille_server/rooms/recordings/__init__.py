"""Recordings on disk: written before anything is told, and taken up after a restart."""
