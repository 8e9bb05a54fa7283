"""Known plans: without what they do not need, and carried out from other states."""
