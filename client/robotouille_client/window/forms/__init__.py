"""Forms of buttons, choices and fields, for mouse, keyboard and gamepad."""
