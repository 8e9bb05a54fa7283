"""Keyboard, mouse and gamepad input, and the actions it stands for."""
