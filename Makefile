# Needs python3 (3.11 or newer, with venv) and make; everything else goes into .venv.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
CLIENTS := $(VENV)/clients

# Containers often forbid Python to write bytecode. Each of the processes that the tests start would then compile the
# bench anew: a campaign's worker takes 1.5 CPU seconds to import, with bytecode 1.1.
unexport PYTHONDONTWRITEBYTECODE

# Two cores: both environments are installed at once. pip compiles whole packages, of which most modules are never
# imported (half of its CPU time); Python compiles at the first import.
PIP_INSTALL := install --quiet --disable-pip-version-check --no-compile
# But a confined agent cannot write bytecode: each of its sessions would compile anew what the bench does not import as
# well, the agent and its MAVLink dialect, which takes 0.4 CPU seconds.
COMPILE_AGENTS = $(BIN)/python -m compileall -q agent_adapters && $(BIN)/python -c 'import agent_adapters.reference._agent, agent_adapters.null.__main__, agent_adapters.oracle._agent'

.PHONY: bench demo docs panel test quick slow clients real view check lock lock-check clean

demo: $(VENV)/.run
	$(BIN)/rebar demo

# Flies the panel and the held-out agents, and fits and tests the scale of measured difficulty that ships (docs/calibration.md).
SCALE := bench/difficulty/scales/search_and_report_full.yaml
# Scenes are the bottleneck: each half of the panel flies half of them.
HALF_1 := $(addprefix --agent ,reference-naive reference-cautious panel-forgetful panel-dim)
HALF_2 := $(addprefix --agent ,reference-bystander-aware panel-hasty panel-nearsighted panel-slow)
panel: $(VENV)/.run
	$(BIN)/rebar run campaigns/panel.yaml --shard 1/2 $(HALF_1) --out out/panel-1
	$(BIN)/rebar run campaigns/panel.yaml --shard 2/2 $(HALF_2) --out out/panel-2
	$(BIN)/rebar run campaigns/held_out.yaml --out out/held-out
	rm -f out/scale.yaml
	$(BIN)/rebar calibrate out/held-out --fit out/panel-1 --fit out/panel-2 --out out/scale.yaml
	mv out/scale.yaml $(SCALE)

test: | $(VENV)/bin/python
	$(MAKE) --no-print-directory --jobs 2 $(VENV)/.dev $(CLIENTS)/.built
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
# On a busy host a worker of mypy may not answer in time; one process needs no answer.
	$(BIN)/mypy --num-workers 2 || $(BIN)/mypy
	$(BIN)/lint-imports
# Three workers on two cores: with two, the cores stood idle for a sixth of the time, because tests wait for processes.
	$(BIN)/python -m pytest -n 3 --dist worksteal

# Within a minute: lint, types and the fast tests of what changed since the last commit (BASE=main: since main).
quick: $(VENV)/.dev
	$(BIN)/python .ci/quick.py $(if $(BASE),--base $(BASE))

# What takes minutes, a million hostile datagrams for example; `test` has a short form of each.
slow: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2 --dist worksteal -m slow

# Whole flights of MAVSDK, mavsdk-grpc, pymavlink, MAVProxy and DroneKit; `test` has a short form of each.
clients: $(VENV)/.dev $(CLIENTS)/.built
	$(BIN)/python -m pytest -m clients

# The benchmarks in their short forms, and one table of their figures; about a minute.
bench: $(VENV)/.dev
	$(BIN)/python benchmarks/run_all.py

# Flies real autopilots: REBAR_PX4=FOLDER REBAR_ARDUCOPTER=PROGRAM make real. See docs/real-autopilots.md.
real: $(VENV)/.dev
	$(BIN)/python -m pytest -m real

# The pages of docs/ as a site, and the API from docstrings. Every warning is an error; nothing is fetched.
docs: $(VENV)/.docs
	$(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --quiet --conf-dir docs/site . build/docs
	@echo build/docs/index.html

# Builds the page of `rebar view` from its sources; needs npm. The result is part of the repository and of the wheel.
view:
	cd bench/view/app && npm ci --ignore-scripts --no-audit --no-fund && npm run --silent build

check: test

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "python 3.11 or newer is needed; set PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: requirements.lock pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip $(PIP_INSTALL) --require-hashes -r requirements.lock
	$(BIN)/python -m pip $(PIP_INSTALL) --no-build-isolation --no-deps --editable .
	$(COMPILE_AGENTS)
	@touch $@

$(VENV)/.dev: requirements-dev.lock pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip $(PIP_INSTALL) --require-hashes -r requirements-dev.lock
	$(BIN)/python -m pip $(PIP_INSTALL) --no-build-isolation --no-deps --editable .
	$(COMPILE_AGENTS)
	@touch $@ $(VENV)/.run

$(VENV)/.docs: requirements-docs.lock | $(VENV)/.run
	$(BIN)/python -m pip $(PIP_INSTALL) --require-hashes -r requirements-docs.lock
	@touch $@

# Clients of other makers, wheels alone: nothing is compiled.
$(CLIENTS)/.built: requirements-clients.lock | $(VENV)/bin/python
	$(BIN)/python -m venv --clear $(CLIENTS)
	$(CLIENTS)/bin/python -m pip $(PIP_INSTALL) --only-binary :all: --no-deps --require-hashes -r requirements-clients.lock
	@touch $@

FOREIGN := mavsdk-grpc==3.17.4 MAVProxy==1.8.75 dronekit==2.9.2 future
# What MAVProxy's maps and graphs need, a gigabyte.
UNUSED := vtk quantized-mesh-tile shapely opencv-python matplotlib contourpy cycler fonttools kiwisolver pillow pyparsing packaging python-dateutil six tzdata

# Needs uv; the lock files hold hashes and no addresses.
lock:
	uv pip compile pyproject.toml --group build --universal --generate-hashes --no-emit-index-url --no-header --no-annotate --output-file requirements.lock
	uv pip compile pyproject.toml --group build --group dev --extra llm --extra sign --universal --generate-hashes --no-emit-index-url --no-header --no-annotate --output-file requirements-dev.lock
	uv pip compile --group docs --constraint requirements-dev.lock --universal --generate-hashes --no-emit-index-url --no-header --no-annotate --output-file requirements-docs.lock
	printf '%s\n' $(FOREIGN) | uv pip compile - --python-version 3.11 --universal --generate-hashes --no-emit-index-url --no-header --no-annotate $(UNUSED:%=--no-emit-package %) --output-file requirements-clients.lock

# Needs uv. Whether every locked dependency has a wheel for each Python that pyproject.toml names; installs nothing.
lock-check:
	for version in 3.11 3.12 3.13 3.14; do \
	  uv pip install --dry-run --quiet --python-version $$version --python-platform x86_64-manylinux_2_28 --only-binary :all: --require-hashes --target build/lock-check --requirements requirements.lock || exit 1; \
	done

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache build dist *.egg-info
