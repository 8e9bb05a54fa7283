"""From a recording to rows, by its frames alone: nothing is simulated."""
