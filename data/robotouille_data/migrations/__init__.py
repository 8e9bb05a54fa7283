"""The versions of the schema, one after the other; a module each, as Alembic reads them."""
