"""Exports of a catalogue as folders of files for other software.

`exporting` writes an export. `tables`, `recorded`, `arrays` and `minari_sets` write its formats,
`documents` its codebook, its card and `export.json`.
"""
