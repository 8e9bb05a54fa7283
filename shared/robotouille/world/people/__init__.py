"""What people are told and offered: their words, and the work that still changes something."""
