"""The server's side of the protocol, connection by connection."""

from robotouille_server.conversation.conversation import Conversation
from robotouille_server.conversation.services import Services, ShutdownNotice

__all__ = ["Conversation", "Services", "ShutdownNotice"]
