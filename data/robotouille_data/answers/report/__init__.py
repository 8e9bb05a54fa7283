"""A study's first look: one page of a catalogue's episodes, compared by a label."""
