"""What somebody at a window does with keys, a mouse or a gamepad, as actions of their player."""
