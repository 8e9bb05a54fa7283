"""Sessions of participants, and the limits on what a seat may send."""
