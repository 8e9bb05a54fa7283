"""Known plans carried out from other states, without a search."""
