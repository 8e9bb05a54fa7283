"""The wire protocol: `messages` and their `error_codes`, a `codec` for each of the two encodings,
`states` as messages carry them, and the `frames` of a WebSocket.

Nothing is imported here: recordings need `states` alone, and the models of all messages take a
while to build.
"""
