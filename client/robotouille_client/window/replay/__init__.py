"""The viewer: recordings, and episodes that one watches, with a timeline below the kitchen.

`history` knows what happened in which step, `timeline` draws that and takes clicks; this package's
own files put both and the window together.
"""
