"""What decides for a seat: at random, by a script, or with a planner."""
