# SPDX-License-Identifier: Apache-2.0
# docker build -t stickslip_ros . && docker run --rm --network host stickslip_ros axis_node
FROM ros:jazzy
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends python3-venv ros-jazzy-robot-state-publisher \
    && rm -rf /var/lib/apt/lists/*
COPY . /src
# Beside ROS' own Python packages; numba and plotly are on PyPI alone.
RUN python3 -m venv --system-site-packages /opt/stickslip \
    && /opt/stickslip/bin/pip install --no-cache-dir /src \
    && /opt/stickslip/bin/stickslip warm-up
ENV PATH=/opt/stickslip/bin:$PATH
CMD ["stickslip", "--help"]
