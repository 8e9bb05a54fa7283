"""What researchers read in recordings: who asked for what and got it or not, and how it went."""
