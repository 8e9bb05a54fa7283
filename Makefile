PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

PYTEST := $(BIN)/python -m pytest -n auto --dist worksteal --durations=20
QUICK := smoke or not (slow or process or browser or nightly)

# Without cached bytecode, every process that a test starts compiles all modules again.
unexport PYTHONDONTWRITEBYTECODE

SEEDS ?= 0:2000
CLUSTERS ?= 0:1000
HOSTILE ?= 1000000
AGREEMENT ?= 10000000

HUBS := robotouille-verifiers robotouille_env robotouille-textarena

UV := 0.13.9
COMPILE := $(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes \
	--no-annotate --no-emit-index-url --no-emit-find-links --custom-compile-command 'make lock' \
	pyproject.toml --group build

.PHONY: help install demo test test-all nightly hubs check docs bench format lock clean

help:  ## List the targets
	@sed -nE 's/^([a-z-]+):.*## (.*)/\1|\2/p' $(MAKEFILE_LIST) | \
		while IFS='|' read -r name words; do printf '  make %-10s %s\n' "$$name" "$$words"; done

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is required; choose one: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	@echo "setting up $(VENV) (a few minutes the first time)"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade 'pip>=25.1'
ifdef LOCKED
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
else
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[all]' --group dev
endif
	@touch $@

install: $(STAMP)  ## Install everything into .venv; every other target does this too

demo: $(STAMP)  ## Watch two bots cook a meal on a real server
	$(BIN)/python examples/demo.py

test: $(STAMP)  ## Run the quick tests: about 90 seconds
	ROBOTOUILLE_FUZZ=0.15 $(PYTEST) -m "$(QUICK)"

test-all: $(STAMP)  ## Run all tests, also with processes, browser and proxies: four to eight minutes
	$(PYTEST)

nightly: $(STAMP)  ## Run drills, many seeds, hostile inputs and floods: hours; SEEDS=FROM:TO CLUSTERS=FROM:TO HOSTILE=COUNT
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[all,local]' --editable packages/robotouille-jax
	ROBOTOUILLE_FUZZ=10 ROBOTOUILLE_ORACLE_TASKS=500 $(PYTEST) -m "nightly or not nightly"
	$(MAKE) hubs
	$(BIN)/python -m tests.programs.simulation --seeds $(SEEDS)
	$(BIN)/python -m tests.programs.simulation --day
	$(BIN)/python -m tests.programs.simulation.cluster --seeds $(CLUSTERS)
	$(BIN)/python -m tests.programs.drill
	$(BIN)/python -m tests.programs.cluster_drill all
	$(BIN)/python -m tests.programs.hostile --count $(HOSTILE)
	$(BIN)/python -m tests.programs.floods
	$(BIN)/python -m tests.programs.every_bit
	$(BIN)/python -m tests.programs.batch_agreement --steps $(AGREEMENT)

# Their libraries need other versions of mcp and openai than the rest, so each has its own environment.
hubs:  ## Test the adapters for verifiers, OpenEnv and TextArena
	set -e; for hub in $(HUBS); do \
		echo "testing $$hub"; \
		$(PYTHON) -m venv out/hubs/$$hub; \
		out/hubs/$$hub/bin/python -m pip install --quiet --disable-pip-version-check --upgrade 'pip>=25.1'; \
		out/hubs/$$hub/bin/python -m pip install --quiet --disable-pip-version-check . ./packages/$$hub --group hubs; \
		out/hubs/$$hub/bin/python -m pytest tests/hubs -m ''; \
	done

check: $(STAMP)  ## Check lint, format, types (also of the browser client) and import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/python -m pytest tests/test_architecture.py tests/web/test_scripts.py

docs: $(STAMP)  ## Build the documentation site in out/site and check every link
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --group docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "out/site/index.html"

bench: $(STAMP)  ## Measure the hot paths and the server on this machine
	$(BIN)/python benchmarks/run.py

format: $(STAMP)  ## Fix what ruff can fix
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock: $(STAMP)  ## Renew the locked versions of CI and the image from pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv==$(UV)
	$(COMPILE) --extra all --group dev --group docs --output-file requirements.lock
	$(COMPILE) --extra operator --extra data --extra mqtt --extra cluster --output-file requirements-image.lock

clean:  ## Remove everything that was built or installed
	rm -rf $(VENV) out build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
