"""From a recording to rows, by its frames alone, but where steps to go are asked for."""
