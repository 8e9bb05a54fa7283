"""A task as arrays of fixed length: ground actions in order, masks, vectors, graphs; and its states
as bytes."""
