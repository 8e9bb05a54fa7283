"""Plans at once, not always the shortest: beam search over joint steps, in any domain."""
