# Everything a person does here, from a fresh clone with Python >= 3.11, make and the package index.
# Nothing is compiled and no display is needed.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL = $(BIN)/python -m pip install -qq --disable-pip-version-check --no-input --only-binary :all:

export MPLBACKEND := Agg

.DEFAULT_GOAL := help
.PHONY: help demo gallery test test-all lint format bench clean chromium

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-9s %s\n", $$1, $$2 }' Makefile

demo: $(VENV)/.installed ## plan the RAF robot's way around a cylinder; results in out/raf-cylinder
	$(BIN)/python problems/raf.py --task cylinder --output out/raf-cylinder

gallery: $(VENV)/.installed ## draw every robot of the library; docs/gallery.md
	PARAOPT_COMPILE=0 $(BIN)/python docs/make_gallery.py

test: lint ## lint, types and all tests but the slow and the browser ones
	$(BIN)/python -m pytest

test-all: lint chromium ## every test, with more random examples and a headless browser
	PARAOPT_TEST_PROFILE=thorough $(BIN)/python -m pytest -m ""

lint: $(VENV)/.installed-dev ## style, format and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.installed-dev ## rewrite the sources in the house format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(VENV)/.installed-bench ## measure speed, side by side in one run
	$(BIN)/python benchmarks/run.py

clean: ## remove the environment, results and caches
	rm -rf $(VENV) out build dist .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find src tests problems benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

chromium:
	@command -v chromium >/dev/null 2>&1 && exit 0; \
	if command -v apt-get >/dev/null 2>&1 && [ "$$(id -u)" = 0 ]; then \
		echo "Installing chromium for the browser tests ..."; \
		apt-get update -qq </dev/null && \
		DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium </dev/null >/dev/null; \
	else \
		echo "make test-all needs 'chromium' on the PATH; on Debian: sudo apt-get install chromium" >&2; exit 1; \
	fi

# Each stamp says that the environment holds what its targets need; a changed pyproject.toml makes it stale.
$(VENV)/.created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "paraopt needs Python >= 3.11; '$(PYTHON)' is $$($(PYTHON) --version 2>&1)." \
			"Name another one: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.installed: EXTRAS = cli,view
$(VENV)/.installed-dev: EXTRAS = dev
$(VENV)/.installed-bench: EXTRAS = bench
$(VENV)/.installed $(VENV)/.installed-dev $(VENV)/.installed-bench: pyproject.toml | $(VENV)/.created
	@echo "Installing paraopt[$(EXTRAS)] into $(VENV) ..."
	@$(INSTALL) -e '.[$(EXTRAS)]'
	@touch $@
