FROM python:3.13.7-slim-bookworm AS build
WORKDIR /src
# By name: recordings and keys that lie beside them are not to get into an image.
COPY pyproject.toml requirements-image.lock README.md LICENSE ./
COPY shared shared
COPY server server
COPY client client
COPY evaluation evaluation
COPY data data
COPY assets assets
COPY domains domains
COPY problems problems
COPY renderings renderings
# The lock file has the extras operator, data, mqtt and cluster, and the build backend.
RUN python -m venv /opt/robotouille \
    && /opt/robotouille/bin/pip install --no-cache-dir --no-deps --require-hashes -r requirements-image.lock \
    && /opt/robotouille/bin/pip install --no-cache-dir --no-deps --no-build-isolation .

FROM python:3.13.7-slim-bookworm
RUN groupadd --gid 10001 robotouille \
    && useradd --uid 10001 --gid 10001 --no-create-home --shell /usr/sbin/nologin robotouille \
    && install --directory --owner 10001 --group 10001 --mode 0750 /recordings \
    && install --directory --owner 10001 --group 10001 --mode 0700 /recordings.state
COPY --from=build /opt/robotouille /opt/robotouille
# From outside, neither the server nor the operator's page takes anybody for a local program.
ENV PATH=/opt/robotouille/bin:$PATH \
    HOME=/tmp \
    PYTHONUNBUFFERED=1 \
    ROBOTOUILLE_HOST=0.0.0.0 \
    ROBOTOUILLE_OPERATOR_HOST=0.0.0.0 \
    ROBOTOUILLE_RECORDINGS=/recordings \
    ROBOTOUILLE_KEYS=/recordings.state/keys.json
USER 10001:10001
WORKDIR /tmp
EXPOSE 8765 8766
HEALTHCHECK --interval=10s --timeout=5s --start-period=30s \
    CMD ["python", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8765/healthz')"]
CMD ["robotouille-server"]
