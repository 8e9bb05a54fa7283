"""A task as arrays of fixed length: numbered actions, masks, vectors and graphs."""
