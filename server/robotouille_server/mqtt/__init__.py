"""MQTT client that publishes a server's episodes and executes commands from laboratory software.

`service.on_broker` runs it. It needs the extra `mqtt`.
"""
