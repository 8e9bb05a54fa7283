"""Pictures, shapes, text and colours from which the layers are drawn."""
