"""What covers the kitchen or lies below it: lobby, pauses, outcome, help, and keys."""
