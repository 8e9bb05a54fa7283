"""Forms: rows of buttons, choices and fields, for a mouse, keys and gamepads alike."""
