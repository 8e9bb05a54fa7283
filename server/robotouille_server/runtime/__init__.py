"""What a process needs whatever it serves: settings, logs, metrics, timers, files it may open.

Import from its modules: `robotouille-server --help` needs the settings, and nothing else of it.
"""
