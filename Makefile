# Every command of this project; `make help` lists them. Needs Python >= 3.11, make and a package index.

# The first Python that is new enough; name another with `make PYTHON=/path/to/python`.
PYTHON ?= $(shell for name in python3.13 python3.12 python3.11 python3; do \
	"$$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 \
	&& { command -v "$$name"; break; }; done)

BIN := .venv/bin
SETUP := .venv/.installed

# The parts of `test` run in the order written, so that pytest's summary is the last line of the log.
.NOTPARALLEL:
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
.PHONY: help setup demo test lint types docs wheel pytest bench format lock clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "make %-7s %s\n", $$1, $$2}' Makefile

setup: $(SETUP) ## make .venv with the pinned packages and this package, editable

$(SETUP): constraints.txt pyproject.toml
	@test -n "$(PYTHON)" || { \
	echo "lithoform needs Python 3.11 or newer; install it, or name it: make PYTHON=/path/to/python" >&2; exit 1; }
	@echo "== set-up: .venv with $(PYTHON) (2 GB; a minute or more the first time)"
	@$(PYTHON) -m venv .venv || { \
	echo "$(PYTHON) cannot make a virtual environment; on Debian install the package python3-venv" >&2; exit 1; }
	@$(BIN)/python -m pip install -qq --require-hashes -r constraints.txt
	@$(BIN)/python -m pip install -qq --no-deps --no-build-isolation --editable .
	@bash scripts/install-debian-packages.sh --if-missing
	@touch $@

demo: $(SETUP) ## make twelve particles and a picture of them
	@$(BIN)/lithoform generate demo --count 12 --seed 1 --class mixed --triangles 20000 --picture --overwrite
	@echo "The particles and their picture are in $(CURDIR)/demo"

test: lint types docs wheel pytest ## all checks: style, types, docs, wheel, tests

lint: $(SETUP) ## check style and formatting
	@echo "== lint"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

types: $(SETUP) ## check types in src
	@echo "== types"
	@$(BIN)/basedpyright

docs: $(SETUP) ## build the documentation into site/
	@echo "== docs"
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

wheel: $(SETUP) ## build the wheel and try it in a bare environment
	@echo "== wheel"
	@$(BIN)/python scripts/check_wheel.py

pytest: $(SETUP) ## run the tests
	@echo "== pytest"
	@$(BIN)/pytest

bench: $(SETUP) ## run the benchmarks
	@$(BIN)/python benchmarks/generation.py
	@$(BIN)/python benchmarks/descriptors.py

format: $(SETUP) ## rewrite the sources in the project's format
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

# uv resolves once for Linux, macOS and Windows and Python 3.11 to 3.14. It is installed in a temporary
# folder, since nothing else needs it. The options keep addresses and paths of this machine out of the files.
lock: ## pin all packages anew in constraints.txt and constraints-core.txt
	@PYTHON="$(PYTHON)" UPGRADE="$(UPGRADE)" bash scripts/lock.sh

clean: ## remove environments, caches and results
	rm -rf .venv .venv-wheel site dist demo .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
