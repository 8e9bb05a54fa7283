"""Where things go in a new instance: a problem taken apart and put together differently."""
