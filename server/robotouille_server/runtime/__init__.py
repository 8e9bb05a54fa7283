"""Runtime of a server process: settings, logs, metrics, timers and limits.

Import from the modules: `robotouille-server --help` needs the settings only.
"""
