"""The panel beside the kitchen: what is to be done, by whom, and how that goes."""
