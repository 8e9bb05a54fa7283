"""Layers of the window: the kitchen, labels, the panel, cards and notices."""
