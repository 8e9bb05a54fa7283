"""The screens of the menu: what each asks, and what was answered."""
