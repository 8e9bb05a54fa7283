"""The delete relaxation: what would be possible if nothing were ever undone."""
