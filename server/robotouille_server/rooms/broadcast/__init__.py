"""What those in a room are sent: what is said of the episode, encoded once, and to whom it goes."""
