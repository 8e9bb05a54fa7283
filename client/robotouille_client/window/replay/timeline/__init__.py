"""The strip below the kitchen: a lane for each seat, marks, a curve, and the log beside it."""
