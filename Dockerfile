# syntax=docker/dockerfile:1
# docker build --tag carigs .                           on a CPU
# docker build --target cuda --tag carigs:cuda .        with CUDA and gsplat, for the training backend `cuda`
# docker run --rm --volume "$PWD:/study" carigs run     a study in the folder ./results

FROM nvidia/cuda:13.0.2-devel-ubuntu24.04 AS cuda
# hadolint ignore=DL3008
RUN apt-get update && \
    apt-get install --yes --no-install-recommends g++ libgomp1 ninja-build python3-dev python3-venv && \
    rm -rf /var/lib/apt/lists/*
WORKDIR /opt/carigs
COPY requirements.lock set_up.py ./
RUN --mount=type=cache,target=/root/.cache/uv \
    UV_LINK_MODE=copy python3 set_up.py --torch lock --only-lock
ENV PATH=/opt/carigs/.venv/bin:$PATH \
    TORCH_EXTENSIONS_DIR=/opt/torch_extensions
# gsplat compiles its kernels when it is imported first; no GPU is needed for that, but the list of those it is for.
RUN TORCH_CUDA_ARCH_LIST="8.0 8.6 8.9 9.0+PTX" MAX_JOBS=4 python -c "import gsplat.cuda._backend as b; assert b._C"
COPY . .
RUN --mount=type=cache,target=/root/.cache/uv \
    UV_LINK_MODE=copy uv pip install --python .venv --no-deps .
RUN useradd --create-home --uid 1001 carigs && mkdir /study && chown -R carigs /study "$TORCH_EXTENSIONS_DIR"
USER 1001
WORKDIR /study
ENTRYPOINT ["carigs"]
CMD ["--help"]

FROM python:3.12-slim-bookworm AS cpu
# hadolint ignore=DL3008
RUN apt-get update && \
    apt-get install --yes --no-install-recommends libgomp1 && \
    rm -rf /var/lib/apt/lists/*
WORKDIR /opt/carigs
COPY requirements.lock set_up.py ./
RUN --mount=type=cache,target=/root/.cache/uv \
    UV_LINK_MODE=copy python3 set_up.py --torch cpu --only-lock
COPY . .
RUN --mount=type=cache,target=/root/.cache/uv \
    UV_LINK_MODE=copy .venv/bin/uv pip install --python .venv --no-deps .
ENV PATH=/opt/carigs/.venv/bin:$PATH
RUN useradd --create-home --uid 1001 carigs && mkdir /study && chown carigs /study
USER 1001
WORKDIR /study
ENTRYPOINT ["carigs"]
CMD ["--help"]
