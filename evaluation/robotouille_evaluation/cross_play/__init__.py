"""Cross-play: all pairs of a population of partners play a task (docs/train.md)."""
