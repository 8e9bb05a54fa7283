"""Pictures, shapes, text and colours that the layers are made of."""
