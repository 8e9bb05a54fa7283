"""Client for browsers: its files, and the looks of shipped kitchens."""

from robotouille.web.site import WebFile, WebSite, shared_site

__all__ = ["WebFile", "WebSite", "shared_site"]
