"""What a task's objects, facts, actions and effects are, worked out once: schemas made ground."""
