"""Words over the kitchen, and where they have room."""
