# make demo    install everything and run the main job on a built-in mesh
# make test    install everything and run all tests; RASTERCOV_NIGHTLY=1 takes larger problems and
#              more examples
# make quick   the same without the slow ones
# make lint    formatting, style, types, weight
# make weight  tokens of what ships, by folder, and what makes code hard to change
# make native  compile what has changed of the loops in C++, as all of the above do
# make dist    dist/: the sdist, and a wheel with the loops for every processor of this kind; one
#              commit gives the same bytes in any folder. ARCHS='x86_64 aarch64 win_amd64 macos_arm64'
#              makes wheels for other machines, too, from this one
# make trial   make dist for all machines; Wine and qemu-user run demo, evaluate, place and check by
#              the wheels for Windows and aarch64, and areas equal those of this machine
# make lib     build/lib and build/include: librastercov for C, without Python; docs/c.md
# make wasm    rastercov/page/web/{engine,lens,readers}.wasm: the engine of pages that compute, by Zig's compiler;
#              a wheel has it. A checkout without it writes pages with recorded figures
# make sanitize  tests of the loops with checked indices, under address, undefined and thread
#              sanitizers; TESTS=tests/mesh takes some
# make stubs   rastercov/engine/*.pyi, types of the loops for mypy and editors, as `make lint` does
# make docs    the documentation as a site, docs/_build/html, without a network
# make site    build/site: the documentation, the playground and three examples that compute, for any
#              static host
# make bench   all figures of the documentation, side by side with a ray tracer, to build/bench; under
#              an hour. MESHES=DIR measures the mesh files there, too
#
# Packages from PyPI have the versions of rastercov/data/constraints.txt, which the tests pass with;
# VERSIONS=newest and VERSIONS=oldest, in a clone of its own, take others, as CI does at night.
#
# All of it lives in .venv and build/native; Mesa's OpenGL and a compiler of C++20 come from the
# system, through apt when they are missing; without root the compiler comes from PyPI. Through apt
# comes OSMesa for the tests, too, where the system still has it: Mesa 25.1 was the last. Chromium, which
# tests of the viewer drive, comes from Debian's package.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
VERSIONS ?= tested
CONSTRAINTS := $(VENV)/constraints.txt
PIP_INSTALL := $(PIP) install -c $(CONSTRAINTS)
LOG := $(VENV)/install.log
# step TEXT COMMAND...: a line with its seconds; what the command says is in the log.
STEP = step() { printf '%s ... ' "$$1"; shift; mkdir -p $(VENV); began=$$(date +%s); \
	if "$$@" >>$(LOG) 2>&1 </dev/null; then echo "$$(($$(date +%s) - began)) s"; \
	else echo "failed; the end of $(LOG):"; tail -n 40 $(LOG); return 1; fi; }; step
MESA := libegl1 libgl1 libgl1-mesa-dri
OSMESA := libosmesa6
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo -n)
APT := $(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get -qq
HAS_EGL = $(BIN)/python -c 'import ctypes; ctypes.CDLL("libEGL.so.1")'
INSTALL_MESA = $(APT) update; $(APT) install -y --no-install-recommends $(MESA)
HAS_OPENGL = $(BIN)/python -c 'from rastercov.gl.context import open_context; open_context().release()'
HAS_OSMESA = $(BIN)/python -c 'from rastercov.gl.context import open_context; open_context("osmesa").release()'
OSMESA_EXISTS = apt-cache policy $(OSMESA) 2>/dev/null | grep -q 'Candidate: [0-9]'
# One thread of Mesa and of numpy a process: tests run in two processes. Those that they start find
# the modules compiled, wherever the environment forbids Python to keep them.
TEST_ENV := env -u PYTHONDONTWRITEBYTECODE LP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

# What compiles the loops, and the options for CMake that .ci/compiler found.
BUILD_TOOLS := 'scikit-build-core>=1.0' 'nanobind>=3.1,<4' 'numpy>=1.26.4' cmake ninja
NATIVE := build/native
CMAKE := env PATH="$(CURDIR)/$(BIN):$$PATH" NINJA_STATUS='[%f/%t, %e s] ' $(BIN)/cmake
CONFIGURED = -G Ninja -S rastercov/engine -DPython_EXECUTABLE=$(CURDIR)/$(BIN)/python -DRASTERCOV_WERROR=$(WERROR) $(CACHE) $$(cat $(VENV)/compiler)
C_CONFIGURED = -G Ninja -S rastercov/engine/c -DRASTERCOV_TESTS=ON -DRASTERCOV_WERROR=$(WERROR) $$(cat $(VENV)/compiler)
CPP := $(wildcard tests/native/cpp/*.?pp tests/native/kernels/*.cpp rastercov/engine/c/without_python/*.?pp \
	rastercov/engine/c/wasm/*.?pp rastercov/engine/c/wasm/*/*.?pp rastercov/engine/*.?pp rastercov/engine/*/*.?pp \
	rastercov/engine/*/*.h rastercov/engine/c/without_python/*/*/*.h examples/c/*.c benchmarks/*.cpp)
# ON: a warning of the compiler ends the build, as in CI; not that of a user.
WERROR ?= OFF
# The target of CMake: the processor's own level, all that it can run, or all known ones.
LEVELS ?= own
# Of `make dist`: kinds of machines, those of .ci/cross.
ARCHS ?= $(shell uname -m)
# Of `make sanitize`.
TESTS ?= tests
# Of `make test`: none takes the engine of pages as it is committed, of the same sources.
COMPILED ?= wasm
# Sources that changed since clang-tidy last found nothing, all where a header did, with the flags of
# what compiles them.
TIDIED := $(if $(wildcard build/native/tidied),$(if $(shell find rastercov/engine -name '*.h*' -newer build/native/tidied),,-newer build/native/tidied))
TIDY = sh -c 'find rastercov/engine -mindepth 2 -name "*.cpp" ! -path "*/wasm/*" $(TIDIED) \
	-printf "%P\n" | sed -E "s,^c/.*,build/c &,; t; s,^,$(NATIVE) ," \
	| xargs -r -L 1 -P $$(nproc) sh -c "$(BIN)/clang-tidy --quiet -p \$$0 rastercov/engine/\$$1"'
# Modules of the page, and what wasm-opt may use: what browsers of 2021 have.
MODULES := engine lens readers
WASM := $(patsubst %,--enable-%,simd bulk-memory nontrapping-float-to-int sign-ext mutable-globals)
SPELLED = $(BIN)/codespell *.md docs examples rastercov reference benchmarks
BIOME := .ci/javascript/node_modules
# The target `native` compiles the loops, and shows how far it is.
INSTALL := $(PIP_INSTALL) --no-build-isolation --config-settings wheel.cmake=false --config-settings wheel.py-api=py3 -e

# Two pips must not work on one environment. `demo` asks for what apt and pip install in one call.
ifndef TOGETHER
.NOTPARALLEL:
endif
.PHONY: demo test quick lint weight native lib wasm crossed dist trial sanitize stubs docs site bench opengl osmesa node chromium clean

test quick: LEVELS := runnable

# From nothing, apt and pip work at once, then the compiler and, for Mesa, apt. The demo counts on the
# CPU where there is no GPU, so missing OpenGL does not stop it. A cache of the compiler has nothing to
# give then, and would take precompiled headers away; Python's is made wherever it may not keep one.
# What tests alone call, a tenth of the compiler's work, is compiled by the next `make native`.
demo: $(BIN)/python
	@[ -e $(VENV)/installed ] || echo "installing what is missing by apt and pip at once, under a minute"
	@$(MAKE) -s --no-print-directory -j 2 --output-sync=target TOGETHER=1 $(VENV)/compiler $(VENV)/installed
	@{ $(HAS_EGL) || sh -c "$(INSTALL_MESA)"; } >>$(LOG) 2>&1 </dev/null & \
	$(MAKE) --no-print-directory native CACHE="-DCCACHE=OFF -DRASTERCOV_KERNELS=OFF" && wait
	@$(MAKE) --no-print-directory opengl || true
	@$(BIN)/python -m compileall -q rastercov reference
	@echo "rastercov demo --out report"
	@$(BIN)/rastercov demo --out report

test: $(VENV)/installed-dev native lib $(COMPILED) opengl osmesa chromium node
	$(TEST_ENV) $(BIN)/python -m pytest -n 2 --dist worksteal -m "" --durations=20

quick: $(VENV)/installed-dev native lib opengl osmesa chromium
	$(TEST_ENV) $(BIN)/python -m pytest -n 2 --dist worksteal

lint: stubs build/c/build.ninja
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(SPELLED)
	@echo clang-format; $(BIN)/clang-format --dry-run --Werror $(CPP)
	@$(STEP) "clang-tidy on what changed of the loops, 2 s a file" $(TIDY) && touch $(NATIVE)/tidied
	@$(BIN)/python .ci/functions.py
	@$(BIN)/python .ci/addresses
	$(BIN)/mypy
	$(BIN)/mypy --config-file .ci/benchmarks.ini
	@if command -v npm >/dev/null && $(MAKE) -s --no-print-directory $(BIOME); then $(BIOME)/.bin/biome lint --error-on-warnings; \
	else echo "note: the page's JavaScript is not checked, which needs npm"; fi
	@$(BIN)/python .ci/weight

# The linter of the viewer's page, of one release, from npm.
$(BIOME): .ci/javascript/package-lock.json
	@$(STEP) "installing Biome by npm, some seconds" npm ci --prefix .ci/javascript --no-audit --no-fund && touch $@

weight: $(BIN)/python
	@$(BIN)/python .ci/weight --table

# Ninja says what it compiles, and nothing where nothing has changed.
native: $(NATIVE)/build.ninja
	@$(if $(CACHE),,! grep -q KERNELS:BOOL=OFF $(NATIVE)/CMakeCache.txt || $(CMAKE) -DRASTERCOV_KERNELS=ON $(NATIVE) >$(LOG))
	@rm -f $(NATIVE)/failed; { $(CMAKE) --build $(NATIVE) --target $(LEVELS) || touch $(NATIVE)/failed; } \
	| { grep --line-buffered -v -e 'no work to do' -e 'Re-checking globbed' -e '^\[.*\(Linking\|nanobind\|_pch\)' || true; }; [ ! -e $(NATIVE)/failed ]

$(NATIVE)/build.ninja: $(VENV)/tools $(VENV)/compiler
	@$(STEP) "configuring the build of the loops in C++" $(CMAKE) -B $(NATIVE) $(CONFIGURED)

# Its tests in C++ want doctest, a header of Debian; without it they are skipped, which says so.
build/c/build.ninja: $(VENV)/tools $(VENV)/compiler
	@[ -e /usr/include/doctest/doctest.h ] || { $(STEP) "asking apt for doctest-dev, some seconds" \
	sh -c "$(APT) update; $(APT) install -y --no-install-recommends doctest-dev" || true; }
	@$(STEP) "configuring librastercov" $(CMAKE) -B build/c $(C_CONFIGURED) -DCMAKE_INSTALL_LIBDIR:STRING=lib

lib: build/c/build.ninja
	@$(STEP) "compiling librastercov, some minutes at first" $(CMAKE) --build build/c && \
	step "putting it into build/lib and build/include" $(CMAKE) --install build/c --prefix build

# Of one thread, for any browser of 2021 or later. Equal bytes in any folder.
wasm: $(VENV)/tools $(VENV)/compiler-dist
	@$(STEP) "configuring the engine for pages" $(CMAKE) -B build/wasm -G Ninja -S rastercov/engine/c \
	$$(cat $(VENV)/compiler-dist) -DCMAKE_CXX_COMPILER_TARGET=wasm32-wasi -DRASTERCOV_WASM=ON \
	-DCMAKE_SYSTEM_NAME=Generic -DCMAKE_TRY_COMPILE_TARGET_TYPE=STATIC_LIBRARY \
	-DPython_EXECUTABLE=$(CURDIR)/$(BIN)/python && \
	step "compiling it, about two minutes at first" $(CMAKE) --build build/wasm && \
	cp $(MODULES:%=build/wasm/%.wasm) rastercov/page/web
	@{ command -v npm >/dev/null && $(MAKE) -s --no-print-directory $(VENV)/binaryen && \
	for module in $(MODULES); do \
	[ $$module = engine ] && more= || more="--flatten --rereloop -Os --code-folding"; \
	$(STEP) "shrinking $$module.wasm, some seconds" \
	$(VENV)/binaryen/node_modules/.bin/wasm-opt $$more --low-memory-unused --merge-similar-functions -Os --const-hoisting -Os --const-hoisting --reorder-locals --reorder-functions $(WASM) build/wasm/$$module.wasm \
	-o rastercov/page/web/$$module.wasm || exit 2; done; } || \
	echo "note: the engine for pages is 14 % larger without wasm-opt, which needs npm"
	@sha256sum $(MODULES:%=rastercov/page/web/%.wasm)

# Binaryen's wasm-opt of one release, from npm.
$(VENV)/binaryen:
	@$(STEP) "installing Binaryen by npm, some seconds" npm install --prefix $@ --no-audit --no-fund binaryen@132.0.0

# Before minutes of compiling: what kinds of machines need, or a line that says why there is none.
crossed: $(VENV)/compiler-dist
	@for arch in $(ARCHS); do $(BIN)/python .ci/cross $$arch build/cross/$$arch >>$(LOG) || exit 2; done

# A wheel is compiled from the sdist by one pinned compiler, whatever this machine is.
dist: $(VENV)/tools $(VENV)/compiler-dist crossed wasm
	@rm -rf dist; for arch in $(ARCHS); do $(STEP) "compiling the loops for all processors of $$arch, some minutes" \
	$(BIN)/python .ci/cross $$arch build/cross/$$arch $$(cat $(VENV)/compiler-dist) || exit 2; done
	@$(BIN)/python .ci/fused dist/*.whl && $(BIN)/twine check --strict dist/* && sha256sum dist/* && \
	$(BIN)/python .ci/fits dist/*.whl

trial: ARCHS := x86_64 aarch64 win_amd64 macos_arm64
trial: dist
	@$(STEP) "installing the wheel of this machine, some seconds" $(PIP_INSTALL) --force-reinstall dist/*manylinux_2_28_$$(uname -m).whl
	@for kind in aarch64 win_amd64; do $(BIN)/python .ci/trial $$kind dist/*$$kind.whl build/trial/$$kind || exit 2; done

sanitize: $(VENV)/installed-dev $(VENV)/compiler
	@for kind in address,undefined thread; do \
	$(STEP) "configuring the loops for the sanitizers $$kind" $(CMAKE) -B build/$$kind \
	-DRASTERCOV_SANITIZE=$$kind -DRASTERCOV_CHECKED=ON -DRASTERCOV_TIGHT=ON $(CONFIGURED) && \
	step "compiling them" $(CMAKE) --build build/$$kind --target own && \
	step "configuring the library of C" $(CMAKE) -B build/c-$$kind $(C_CONFIGURED) \
	-DRASTERCOV_SANITIZE=$$kind -DRASTERCOV_CHECKED=ON -DRASTERCOV_TIGHT=ON && \
	step "compiling it" $(CMAKE) --build build/c-$$kind && \
	$(BIN)/ctest --test-dir build/c-$$kind --output-on-failure && \
	(. build/$$kind/sanitizer && $(TEST_ENV) RASTERCOV_MODULES=build/$$kind/modules \
	$(BIN)/python -m pytest -q -s -m native $(TESTS)) || exit 2; \
	done

stubs: $(VENV)/installed-dev native
	$(BIN)/python .ci/stubs

# A warning, a link that leads nowhere or a misspelt word ends it.
docs: $(VENV)/installed-docs native
	$(SPELLED)
	$(BIN)/python -m sphinx -q -W --keep-going -j auto -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

site: wasm docs
	@rm -rf build/site; cp -r docs/_build/html build/site
	@$(STEP) "writing pages that compute, some seconds" $(BIN)/python .ci/site build/site
	@echo "build/site/index.html"

# Open3D's wheel leaves libusb to the system.
bench: $(VENV)/installed-bench native opengl
	@ldconfig -p | grep -q libusb-1.0.so.0 || \
	{ $(STEP) "installing libusb, some seconds" $(APT) install -y libusb-1.0-0; } || \
	{ echo "error: Open3D needs libusb; as root: apt-get install -y libusb-1.0-0"; exit 2; }
	$(BIN)/python benchmarks/everything.py $(if $(MESHES),--meshes $(MESHES))

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12), (3, 13), (3, 14)))' || \
	{ echo "error: expected Python 3.11 to 3.14, got another version; run make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	@$(STEP) "making $(VENV), some seconds" $(PYTHON) -m venv $(VENV) || \
	{ package=$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
	rm -rf $(VENV)/bin; step "installing $$package and making $(VENV), about 20 s" \
	sh -c "$(APT) update; $(APT) install -y $$package && $(PYTHON) -m venv $(VENV)" || \
	{ rm -rf $(VENV)/bin; echo "error: $(PYTHON) makes no virtual environment; as root: apt-get install -y $$package"; exit 2; }; }

$(CONSTRAINTS): $(BIN)/python pyproject.toml rastercov/data/constraints.txt .ci/versions
	@$(BIN)/python .ci/versions $(VERSIONS) >$@.new && mv $@.new $@

$(VENV)/tools: $(CONSTRAINTS)
	@$(STEP) "installing CMake, Ninja and nanobind in $(VENV), some seconds" $(PIP_INSTALL) $(BUILD_TOOLS)
	@touch $@

$(VENV)/compiler: $(BIN)/python .ci/compiler
	@TOGETHER=$(TOGETHER) sh .ci/compiler $@ $(LOG) $(BIN)/python $(APT)

$(VENV)/compiler-dist: $(VENV)/tools .ci/compiler
	@$(STEP) "installing what packs a release, some seconds" $(PIP_INSTALL) 'build>=1.2' 'twine>=6.1'
	@CXX=zig sh .ci/compiler $@ $(LOG) $(BIN)/python $(APT)

$(VENV)/installed: $(VENV)/tools pyproject.toml
	@$(STEP) "installing rastercov and what it needs in $(VENV), about a minute" $(INSTALL) .
	@touch $@

# There is no wheel of moderngl for aarch64: pip compiles it, with headers of X11.
ifeq ($(shell uname -m),aarch64)
$(VENV)/installed-dev: $(VENV)/x11
endif
$(VENV)/x11: $(VENV)/compiler
	@$(STEP) "installing headers of X11, some seconds" sh -c "$(APT) update; $(APT) install -y --no-install-recommends libx11-dev"
	@touch $@

$(VENV)/installed-dev: $(VENV)/tools pyproject.toml
	@$(STEP) "installing rastercov and what its tests need in $(VENV), about 2 minutes" $(INSTALL) '.[dev]'
	@touch $@ $(VENV)/installed

$(VENV)/installed-docs: $(VENV)/tools pyproject.toml
	@$(STEP) "installing rastercov and what its documentation needs in $(VENV), about a minute" $(INSTALL) '.[docs]'
	@touch $@ $(VENV)/installed

$(VENV)/installed-bench: $(VENV)/tools pyproject.toml
	@$(STEP) "installing rastercov and its peers in $(VENV), about 2 minutes" $(INSTALL) '.[bench]'
	@touch $@ $(VENV)/installed

opengl: $(VENV)/installed
	@$(HAS_OPENGL) 2>/dev/null || \
	{ $(STEP) "installing Mesa ($(MESA)), about 30 s" \
	sh -c "$(INSTALL_MESA)" && $(HAS_OPENGL) 2>>$(LOG) || \
	{ echo "error: no OpenGL; as root: apt-get install -y $(MESA); then ask: $(BIN)/rastercov doctor"; exit 2; }; }

# Without it its tests are skipped, which the end of the run says.
osmesa: $(VENV)/installed
	@if $(HAS_OSMESA) 2>/dev/null; then exit 0; fi; \
	$(STEP) "asking apt for $(OSMESA), some seconds" $(APT) update; \
	if $(OSMESA_EXISTS); then step "installing OSMesa ($(OSMESA)), about 20 s" \
	$(APT) install -y --no-install-recommends $(OSMESA) && exit 0; fi; \
	echo "note: no OSMesa: apt has no $(OSMESA), or may not install it"

# Without it its tests are skipped, which the end of the run says.
node:
	@command -v node >/dev/null || { $(STEP) "installing Node, some seconds" \
	sh -c "$(APT) update; $(APT) install -y --no-install-recommends nodejs"; } || \
	echo "note: no Node: apt has none, or may not install it"

# Without it its tests are skipped, which the end of the run says.
chromium:
	@if command -v chromium >/dev/null || command -v chromium-browser >/dev/null; then exit 0; fi; \
	$(STEP) "installing Chromium, about a minute" \
	sh -c "$(APT) update; $(APT) install -y --no-install-recommends chromium" || \
	echo "note: no Chromium: apt has none, or may not install it"

clean:
	rm -rf $(VENV) report render build dist docs/_build docs/reference *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
