"""What reports have in common: figures, and the style of pages that need nothing beside them."""
