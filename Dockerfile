# docker build -t rastercov .
# docker run --rm --user "$(id -u)" -v "$PWD:/data" rastercov check plan.toml --poses rig.json
FROM python:3.13-slim-trixie

# Mesa's OpenGL, for pictures and methods that draw; check needs none of it.
RUN apt-get update \
 && apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri \
 && rm -rf /var/lib/apt/lists/*

# Loops for any processor, so that those of the image are found wherever it runs, by any user.
ENV NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES= \
    NUMBA_CACHE_DIR=/var/cache/rastercov MPLCONFIGDIR=/tmp/matplotlib

COPY . /src
RUN pip install --no-cache-dir /src \
 && useradd --create-home rastercov \
 && install --directory --mode=1777 /var/cache/rastercov

# A check compiles its loops, in about two minutes; runs from then on take seconds.
USER rastercov
RUN rastercov check /src/examples/plans/audit_rig.toml --poses /src/examples/plans/rig.json \
    --min-coverage 0.5 --out /tmp/check \
 && chmod --recursive a+rwX /var/cache/rastercov/* \
 && rm -r /tmp/check

WORKDIR /data
ENTRYPOINT ["rastercov"]
