"""Wire protocol: messages, error codes, codecs, states in messages, and WebSocket frames.

This package imports nothing: recordings need `states` only, and the message models are slow to
build.
"""
