"""The subcommands of `robotouille`."""
