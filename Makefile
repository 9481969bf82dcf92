# make demo    install everything and run the main job on a built-in mesh
# make test    install everything and run the tests
# make lint    formatting, style, types
# make bench   speed against a ray tracer, side by side
#
# All of it lives in .venv; Mesa's OpenGL comes from the system, through apt when it is missing.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
MESA := libegl1 libgl1 libgl1-mesa-dri
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo -n)
# One Mesa thread a process: tests run in two processes.
TEST_ENV := LP_NUM_THREADS=1

.PHONY: demo test lint bench opengl clean

demo: $(VENV)/installed opengl
	$(BIN)/rastercov demo --out report

test: $(VENV)/installed-dev opengl
	$(TEST_ENV) $(BIN)/python -m pytest -n 2 --dist worksteal

lint: $(VENV)/installed-dev
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy

bench: $(VENV)/installed-bench opengl
	$(BIN)/python benchmarks/throughput.py

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12), (3, 13)))' || \
	{ echo "error: rastercov wants Python 3.11 to 3.13; pass one: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	@$(PYTHON) -m venv $(VENV) 2>/dev/null || \
	{ $(SUDO) apt-get -qq update && $(SUDO) apt-get -qq install -y python3-venv && $(PYTHON) -m venv --clear $(VENV); } || \
	{ rm -rf $(VENV); echo "error: $(PYTHON) cannot make a virtual environment; install python3-venv"; exit 2; }

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
	@$(BIN)/python -c 'from rastercov.raster.egl import open_context; open_context().release()' 2>/dev/null || \
	{ echo "installing Mesa: $(MESA)"; $(SUDO) apt-get -qq update && $(SUDO) apt-get -qq install -y --no-install-recommends $(MESA); } || \
	{ echo "error: no OpenGL; as root: apt-get install -y $(MESA)"; exit 2; }

$(VENV)/installed: | $(BIN)/python

clean:
	rm -rf $(VENV) report render build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
