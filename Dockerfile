FROM python:3.12-slim
WORKDIR /app
# By name: recordings and keys that lie beside them are not to get into an image.
COPY pyproject.toml README.md LICENSE ./
COPY shared shared
COPY server server
COPY client client
COPY evaluation evaluation
COPY data data
COPY assets assets
COPY domains domains
COPY problems problems
COPY renderings renderings
RUN pip install --no-cache-dir .
EXPOSE 8765
CMD ["robotouille-server", "--host", "0.0.0.0"]
