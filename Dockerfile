# The demo in a container:  docker build -t handwave . && docker run --rm -it handwave
FROM debian:bookworm-slim
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3 python3-venv python3-dev g++ cmake make \
 && rm -rf /var/lib/apt/lists/*
RUN useradd --create-home handwave
USER handwave
WORKDIR /home/handwave/handwave
COPY --chown=handwave . .
RUN make setup
CMD ["make", "demo", "ARGS=--headless"]
