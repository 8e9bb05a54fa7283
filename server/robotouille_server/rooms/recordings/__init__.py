"""Recordings on disk: written before anything is published, and taken up after a restart."""
