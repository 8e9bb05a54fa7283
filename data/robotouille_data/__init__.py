"""Catalogue of recordings: episodes, seats, steps and events as tables of a database.

Recordings are the only source of a catalogue, so indexing them again gives the same rows.
"""
