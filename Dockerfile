# UPPLIED with everything that a server, a worker and a machine that plans need: compose.yaml runs them all.
FROM python:3.13-slim-bookworm

# What Open3D loads; Debian 12 has the C library that it wants.
RUN apt-get update \
 && apt-get install --yes --no-install-recommends libgomp1 libgl1 libegl1 libx11-6 \
 && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/upplied
COPY requirements-runtime.lock .
RUN python -m pip install --no-cache-dir --no-deps --require-hashes --only-binary :all: -r requirements-runtime.lock
COPY pyproject.toml setup.py MANIFEST.in README.md LICENSE prefect.yaml ./
COPY flows flows
COPY upplied upplied
RUN python -m pip install --no-cache-dir --no-deps --no-build-isolation . \
 && useradd --create-home --uid 1000 upplied \
 && mkdir /fleet \
 && chown upplied /fleet

# The fleet's folder: catalog, reports and Prefect's own. Mount what should stay; meshes and logs are read from where
# UPPLIED_ROOTS says (compose.yaml mounts them under /data). Nothing here runs as root, and uid 1000 must be able to read them.
USER upplied
WORKDIR /fleet
ENV UPPLIED_HOME=/fleet DO_NOT_TRACK=1
EXPOSE 4200 4201
ENTRYPOINT ["upplied"]
CMD ["serve"]
