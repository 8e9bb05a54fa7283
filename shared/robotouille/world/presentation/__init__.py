"""Words for people, and the actions that are worth offering to them."""
