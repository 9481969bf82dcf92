# make demo    install everything and run the main job on a built-in mesh
# make test    install everything and run all tests, a third of the cases of tests with many slow
#              ones; RASTERCOV_NIGHTLY=1 runs all cases and larger problems
# make quick   the same without the slow ones
# make lint    formatting, style, types
# make bench   exactness and speed, side by side with a ray tracer
#
# All of it lives in .venv; Mesa's OpenGL comes from the system, through apt when it is missing. So
# does OSMesa for the tests, where the system still has it: Mesa 25.1 was the last. Chromium, which
# tests of the viewer drive, comes from Debian's package.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
MESA := libegl1 libgl1 libgl1-mesa-dri
OSMESA := libosmesa6
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo -n)
APT := $(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get -qq
HAS_OPENGL = $(BIN)/python -c 'from rastercov.raster.gl.context import open_context; open_context().release()'
HAS_OSMESA = $(BIN)/python -c 'from rastercov.raster.gl.context import open_context; open_context("osmesa").release()'
OSMESA_EXISTS = apt-cache policy $(OSMESA) 2>/dev/null | grep -q 'Candidate: [0-9]'
# One thread of Mesa and of numpy a process: tests run in two processes. Those that they start find
# the modules compiled, wherever the environment forbids Python to keep them.
TEST_ENV := env -u PYTHONDONTWRITEBYTECODE LP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
BY_DAY := $(if $(filter 1,$(RASTERCOV_NIGHTLY)),,--by-day)

# Two pips must not work on one environment.
.NOTPARALLEL:
.PHONY: demo test quick lint bench opengl osmesa chromium clean

# The demo counts on the CPU where there is no GPU, so missing OpenGL does not stop it.
demo: $(VENV)/installed
	@$(MAKE) --no-print-directory opengl || true
	$(BIN)/rastercov demo --out report

test: $(VENV)/installed-dev opengl osmesa chromium
	$(TEST_ENV) $(BIN)/python -m pytest -n 2 --dist worksteal -m "" --durations=40 $(BY_DAY)

quick: $(VENV)/installed-dev opengl osmesa chromium
	$(TEST_ENV) $(BIN)/python -m pytest -n 2 --dist worksteal

lint: $(VENV)/installed-dev
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy

# Open3D's wheel leaves libusb to the system.
bench: $(VENV)/installed-bench opengl
	@ldconfig -p | grep -q libusb-1.0.so.0 || $(APT) install -y libusb-1.0-0 </dev/null || \
	{ echo "error: Open3D needs libusb; as root: apt-get install -y libusb-1.0-0"; exit 2; }
	$(BIN)/python benchmarks/exactness.py
	$(BIN)/python benchmarks/throughput.py

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12), (3, 13)))' || \
	{ echo "error: rastercov wants Python 3.11 to 3.13; pass one: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	@$(PYTHON) -m venv $(VENV) >/dev/null 2>&1 || \
	{ package=$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
	echo "installing $$package"; rm -rf $(VENV); \
	{ $(APT) update; $(APT) install -y $$package && $(PYTHON) -m venv $(VENV); } </dev/null || \
	{ rm -rf $(VENV); echo "error: $(PYTHON) makes no virtual environment; as root: apt-get install -y $$package"; exit 2; }; }

$(VENV)/installed: $(BIN)/python pyproject.toml
	$(PIP) install -e .
	@touch $@

$(VENV)/installed-dev: $(BIN)/python pyproject.toml
	$(PIP) install -e '.[dev]'
	@touch $@ $(VENV)/installed

$(VENV)/installed-bench: $(BIN)/python pyproject.toml
	$(PIP) install -e '.[bench]'
	@touch $@ $(VENV)/installed

opengl: $(VENV)/installed
	@$(HAS_OPENGL) 2>/dev/null || \
	{ echo "installing Mesa: $(MESA)"; \
	{ $(APT) update; $(APT) install -y --no-install-recommends $(MESA) && $(HAS_OPENGL); } </dev/null || \
	{ echo "error: no OpenGL; as root: apt-get install -y $(MESA); then ask: $(BIN)/rastercov doctor"; exit 2; }; }

# Without it its tests are skipped, which the end of the run says.
osmesa: $(VENV)/installed
	@if $(HAS_OSMESA) 2>/dev/null; then exit 0; fi; \
	$(APT) update </dev/null 2>/dev/null; \
	if $(OSMESA_EXISTS); then echo "installing OSMesa: $(OSMESA)"; \
	$(APT) install -y --no-install-recommends $(OSMESA) </dev/null && exit 0; fi; \
	echo "note: no OSMesa: apt has no $(OSMESA), or may not install it"

# Without it its tests are skipped, which the end of the run says.
chromium:
	@if command -v chromium >/dev/null || command -v chromium-browser >/dev/null; then exit 0; fi; \
	echo "installing Chromium"; { $(APT) update; \
	$(APT) install -y --no-install-recommends chromium; } </dev/null || \
	echo "note: no Chromium: apt has none, or may not install it"

clean:
	rm -rf $(VENV) report render build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
