# `gs` as a container: `cargo xtask dist` first, then `docker build -t gs .`; docs/install.md has more.
FROM debian:trixie-slim
# NVIDIA's driver, which the container toolkit brings, needs libxext6.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libvulkan1 libxext6 mesa-vulkan-drivers \
    && rm -rf /var/lib/apt/lists/*
ARG TARGETARCH
COPY target/dist/*_${TARGETARCH}.deb /tmp/
RUN dpkg --install /tmp/*.deb && rm /tmp/*.deb
WORKDIR /data
ENTRYPOINT ["gaussian-splats"]
CMD ["--help"]
