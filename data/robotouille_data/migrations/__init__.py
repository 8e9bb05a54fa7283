"""Alembic migrations of the catalogue, one module for each version of the schema."""
