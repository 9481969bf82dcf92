# docker build -t rastercov .
# docker run --rm --user "$(id -u)" -v "$PWD:/data" rastercov check plan.toml --poses rig.json
FROM python:3.13-slim-trixie AS compiler

# A wheel with the loops for every processor of this kind.
RUN apt-get update && apt-get install -y --no-install-recommends g++
COPY . /src
RUN pip wheel --no-deps --wheel-dir /wheels /src

FROM python:3.13-slim-trixie

# Mesa's OpenGL, for pictures and methods that draw; check needs none of it.
# --build-arg PACKAGES=chromium adds reports as PDF.
ARG PACKAGES=
RUN apt-get update \
 && apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri $PACKAGES \
 && rm -rf /var/lib/apt/lists/*

# STEP, and IFC, PDF and DXF; --build-arg EXTRAS= leaves them out.
ARG EXTRAS=[formats,building]
COPY --from=compiler /wheels /src/rastercov/data/constraints.txt /wheels/
RUN pip install --no-cache-dir -c /wheels/constraints.txt "$(ls /wheels/*.whl)$EXTRAS" \
 && useradd --create-home rastercov

USER rastercov
WORKDIR /data
ENTRYPOINT ["rastercov"]
