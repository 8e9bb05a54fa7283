"""The operator page: a second port with a web page and an HTTP API. Needs the extra `operator`."""

from robotouille_server.operator.serving import OperatorPort, openapi, operator_view

__all__ = ["OperatorPort", "openapi", "operator_view"]
