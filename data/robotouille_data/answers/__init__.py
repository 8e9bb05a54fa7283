"""What is asked of a catalogue: queries that only read, files and pictures of answers, a report."""
