"""Paints a view: layers from the floor to what floats above everything."""
