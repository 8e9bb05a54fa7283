"""Cards over the kitchen and the strip below it: lobby, pauses, outcome, help and keys."""
