# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml $(shell find src -name '*.py' -o -name '*.csv' -o -name '*.toml')

.PHONY: demo test lint docs bench clean

demo: $(VENV)/.demo
	$(BIN)/gridfold demo

# Compiled code is cached by source file; a change in a function that a kernel of another file calls
# does not renew that file's cache, so the checks start without one.
test: $(VENV)/.dev lint docs
	find src -name '*.nb[ic]' -delete
	$(BIN)/pytest

lint: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/.dev
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html

bench: $(VENV)/.dev
	$(BIN)/python benchmarks/run_all.py

clean:
	rm -rf $(VENV) build docs/_build docs/_generated gridfold-demo

$(VENV)/bin/pip:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "gridfold needs Python 3.11 or later")'
	$(PYTHON) -m venv $(VENV)

# The demonstration needs the package alone; it is installed from this folder.
$(VENV)/.demo: $(VENV)/bin/pip $(SOURCES)
	test -f $(VENV)/.dev || $(BIN)/pip install --quiet .
	touch $@

# The checks need the development extra, with the package in place.
$(VENV)/.dev: $(VENV)/bin/pip pyproject.toml
	$(BIN)/pip install --quiet --editable '.[dev]'
	touch $@
