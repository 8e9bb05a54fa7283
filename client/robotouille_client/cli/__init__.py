"""The commands that need no server, and what all commands share."""
