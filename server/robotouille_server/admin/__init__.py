"""The operator's view: a second port with a page and an HTTP API. Needs the extra `operator`."""

from robotouille_server.admin.http.serving import OperatorPort, openapi, operator_view

__all__ = ["OperatorPort", "openapi", "operator_view"]
