"""Live streams: what goes on, told to an MQTT broker, and its commands. Needs the extra `mqtt`."""

from robotouille_server.mqtt.broker_service import on_broker

__all__ = ["on_broker"]
