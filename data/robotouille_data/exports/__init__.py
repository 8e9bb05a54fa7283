"""Exports: a catalogue, or a part of it, as a folder of files that other software loads.

`exporting` is the beginning; `formats/` write the data, and all else stands beside it: the
codebook, the card and `export.json`.
"""
