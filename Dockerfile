# SPDX-License-Identifier: Apache-2.0
# The programs of the wheel that scripts/build_wheels.sh makes in dist/. In this folder:
#   docker build -t jade-gs . && docker run --rm -v "$PWD:/data" jade-gs jade_demo
# With `--gpus all` and NVIDIA's container toolkit the programs use a GPU.
FROM debian:12-slim
# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3-venv ffmpeg \
 && rm -rf /var/lib/apt/lists/*
ENV PATH="/opt/jade/bin:$PATH"
RUN --mount=type=bind,source=dist,target=/dist \
    python3 -m venv /opt/jade \
 && pip install --no-cache-dir /dist/jade_gs-*.whl
WORKDIR /data
CMD ["jade_train", "--help"]
