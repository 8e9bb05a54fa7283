#!/bin/sh
# Create the roles of the catalogue. PostgreSQL runs this as superuser when it creates the database.
# `robotouille` owns the catalogue and writes it. `reader` can only read it, for queries and Grafana.
set -eu
psql --no-psqlrc --quiet --set=ON_ERROR_STOP=1 --username "$POSTGRES_USER" --dbname "$POSTGRES_DB" <<'SQL'
\set owner_password `cat /run/secrets/postgres_owner`
\set reader_password `cat /run/secrets/postgres_reader`
CREATE ROLE robotouille LOGIN PASSWORD :'owner_password';
ALTER DATABASE robotouille OWNER TO robotouille;

CREATE ROLE reader LOGIN PASSWORD :'reader_password' CONNECTION LIMIT 20;
ALTER ROLE reader SET default_transaction_read_only = on;
ALTER ROLE reader SET statement_timeout = '60s';
GRANT USAGE ON SCHEMA public TO reader;
ALTER DEFAULT PRIVILEGES FOR ROLE robotouille IN SCHEMA public GRANT SELECT ON TABLES TO reader;

-- A reader can end its read-only transaction. It must not fill the disk then.
REVOKE TEMPORARY ON DATABASE robotouille FROM PUBLIC;
REVOKE EXECUTE ON FUNCTION lo_creat(integer), lo_create(oid), lo_from_bytea(oid, bytea) FROM PUBLIC;
SQL
