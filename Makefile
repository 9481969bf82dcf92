# make demo    install everything and run the main job on a built-in mesh
# make test    install everything and run all tests; RASTERCOV_NIGHTLY=1 takes larger problems and
#              more examples
# make quick   the same without the slow ones
# make lint    formatting, style, types
# make docs    the documentation as a site, docs/_build/html, without a network
# make bench   exactness and speed, side by side with a ray tracer
#
# All of it lives in .venv; Mesa's OpenGL comes from the system, through apt when it is missing. So
# does OSMesa for the tests, where the system still has it: Mesa 25.1 was the last. Chromium, which
# tests of the viewer drive, comes from Debian's package.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
LOG := $(VENV)/install.log
# step TEXT COMMAND...: a line with its seconds; what the command says is in the log.
STEP = step() { printf '%s ... ' "$$1"; shift; mkdir -p $(VENV); began=$$(date +%s); \
	if "$$@" >>$(LOG) 2>&1 </dev/null; then echo "$$(($$(date +%s) - began)) s"; \
	else echo "failed, see $(LOG)"; return 1; fi; }; step
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

# Two pips must not work on one environment.
.NOTPARALLEL:
.PHONY: demo test quick lint docs bench opengl osmesa chromium clean

# The demo counts on the CPU where there is no GPU, so missing OpenGL does not stop it.
demo: $(VENV)/installed
	@$(MAKE) --no-print-directory opengl || true
	@echo "rastercov demo --out report"
	@$(BIN)/rastercov demo --out report

test: $(VENV)/installed-dev opengl osmesa chromium
	$(TEST_ENV) $(BIN)/python -m pytest -n 2 --dist worksteal -m "" --durations=20

quick: $(VENV)/installed-dev opengl osmesa chromium
	$(TEST_ENV) $(BIN)/python -m pytest -n 2 --dist worksteal

lint: $(VENV)/installed-dev
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy

# A warning, a link that leads nowhere or a misspelt word ends it.
docs: $(VENV)/installed-docs
	$(BIN)/codespell README.md docs examples rastercov reference benchmarks
	$(BIN)/python -m sphinx -q -W --keep-going -j auto -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

# Open3D's wheel leaves libusb to the system.
bench: $(VENV)/installed-bench opengl
	@ldconfig -p | grep -q libusb-1.0.so.0 || \
	{ $(STEP) "installing libusb, some seconds" $(APT) install -y libusb-1.0-0; } || \
	{ echo "error: Open3D needs libusb; as root: apt-get install -y libusb-1.0-0"; exit 2; }
	$(BIN)/python benchmarks/exactness.py
	$(BIN)/python benchmarks/throughput.py

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12), (3, 13)))' || \
	{ echo "error: rastercov wants Python 3.11 to 3.13; pass one: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	@$(STEP) "making $(VENV), some seconds" $(PYTHON) -m venv $(VENV) || \
	{ package=$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
	rm -rf $(VENV)/bin; step "installing $$package and making $(VENV), about 20 s" \
	sh -c "$(APT) update; $(APT) install -y $$package && $(PYTHON) -m venv $(VENV)" || \
	{ rm -rf $(VENV)/bin; echo "error: $(PYTHON) makes no virtual environment; as root: apt-get install -y $$package"; exit 2; }; }

$(VENV)/installed: $(BIN)/python pyproject.toml
	@$(STEP) "installing rastercov and what it needs in $(VENV), about a minute" $(PIP) install -e .
	@touch $@

$(VENV)/installed-dev: $(BIN)/python pyproject.toml
	@$(STEP) "installing rastercov and what its tests need in $(VENV), about 2 minutes" $(PIP) install -e '.[dev]'
	@touch $@ $(VENV)/installed

$(VENV)/installed-docs: $(BIN)/python pyproject.toml
	@$(STEP) "installing rastercov and what its documentation needs in $(VENV), about a minute" $(PIP) install -e '.[docs]'
	@touch $@ $(VENV)/installed

$(VENV)/installed-bench: $(BIN)/python pyproject.toml
	@$(STEP) "installing rastercov and its peers in $(VENV), about 2 minutes" $(PIP) install -e '.[bench]'
	@touch $@ $(VENV)/installed

opengl: $(VENV)/installed
	@$(HAS_OPENGL) 2>/dev/null || \
	{ $(STEP) "installing Mesa ($(MESA)), about 30 s" \
	sh -c "$(APT) update; $(APT) install -y --no-install-recommends $(MESA)" && $(HAS_OPENGL) 2>>$(LOG) || \
	{ echo "error: no OpenGL; as root: apt-get install -y $(MESA); then ask: $(BIN)/rastercov doctor"; exit 2; }; }

# Without it its tests are skipped, which the end of the run says.
osmesa: $(VENV)/installed
	@if $(HAS_OSMESA) 2>/dev/null; then exit 0; fi; \
	$(STEP) "asking apt for $(OSMESA), some seconds" $(APT) update; \
	if $(OSMESA_EXISTS); then step "installing OSMesa ($(OSMESA)), about 20 s" \
	$(APT) install -y --no-install-recommends $(OSMESA) && exit 0; fi; \
	echo "note: no OSMesa: apt has no $(OSMESA), or may not install it"

# Without it its tests are skipped, which the end of the run says.
chromium:
	@if command -v chromium >/dev/null || command -v chromium-browser >/dev/null; then exit 0; fi; \
	$(STEP) "installing Chromium, about a minute" \
	sh -c "$(APT) update; $(APT) install -y --no-install-recommends chromium" || \
	echo "note: no Chromium: apt has none, or may not install it"

clean:
	rm -rf $(VENV) report render build dist docs/_build docs/reference *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
