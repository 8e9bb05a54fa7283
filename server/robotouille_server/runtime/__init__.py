"""What a server process needs whatever it serves: settings, logs, metrics, time, workers."""
