"""What is asked of a catalogue: queries that only read, and files of answers."""
