# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PEERS := .venv-peers
SOURCES := pyproject.toml setup.py $(shell find src -name '*.py*' -not -name '*.pyc' -o -name '*.csv' -o -name '*.toml' -o -path '*/page/*')

.PHONY: demo test test-browser test-matrix fuzz lint docs kill-test bench bench-peers bench-psse bench-public bench-polish bench-low-rank bench-auto bench-batch test-cuda clean

demo: $(VENV)/.demo
	$(BIN)/gridfold demo

test: $(VENV)/.dev lint docs
	$(BIN)/pytest -n auto --maxprocesses 8 --dist loadfile

# The report of a study in a Chromium that is there.
test-browser: $(VENV)/.dev
	$(BIN)/pytest tests/browser

# Every kind of event on an NVIDIA GPU against the CPU, and the rate; writes its page. Needs a GPU.
test-cuda: $(VENV)/.dev
	$(BIN)/pip install --quiet --editable '.[cuda]'
	$(BIN)/python benchmarks/cuda.py

lint: $(VENV)/.dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/.dev
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html

# 500 kills at work, over threads, processes and a local cluster: some hours.
kill-test: $(VENV)/.dev
	$(BIN)/python benchmarks/kill_and_resume.py

# Spoilt input for every reader and the command. MINUTES of it; it goes on where it ended.
MINUTES ?= 10
SEED ?= 1
fuzz: $(VENV)/.dev
	PYTHONPATH=tests:benchmarks $(BIN)/python -m fuzz --minutes $(MINUTES) --seed $(SEED)

# The tests on the lowest and the newest versions of all packages, on every Python that is found.
test-matrix:
	$(PYTHON) tests/matrix.py .venv-matrix

bench: $(VENV)/.dev
	$(BIN)/python benchmarks/run_all.py

# gridfold beside other tools, on the cases that GRIDFOLD_CASES names.
bench-peers: bench-psse $(PEERS)/.ready
	PYTHONPATH=benchmarks $(BIN)/python benchmarks/peers/compare_andes.py
	PYTHONPATH=benchmarks $(BIN)/python benchmarks/peers/compare_wecc.py

# The same for trajectories of PSS/E alone, which needs no other tool.
bench-psse: $(VENV)/.dev
	PYTHONPATH=tests:benchmarks $(BIN)/python benchmarks/peers/compare_psse.py

# Five public cases: start, rest, fault, trip and time.
bench-public: $(VENV)/.dev
	$(BIN)/python benchmarks/public_cases.py

# Reduced models of a grid of 327 machines, from the cases that GRIDFOLD_CASES names.
bench-polish: $(VENV)/.dev
	$(BIN)/python benchmarks/polish.py

# Contingencies side by side against one by one; the Polish grid as above.
bench-batch: $(VENV)/.dev
	$(BIN)/python benchmarks/batch.py

# External areas of up to 27,000 states reduced by sparse factors; the Polish grid as above.
bench-low-rank: $(VENV)/.dev
	$(BIN)/python benchmarks/low_rank.py

# Studies with the default model, from the cases that GRIDFOLD_CASES names.
bench-auto: $(VENV)/.dev
	$(BIN)/python benchmarks/auto_studies.py

clean:
	rm -rf $(VENV) $(PEERS) .venv-matrix .fuzz.json build docs/_build docs/_generated gridfold-demo

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

# Every line of the requirements becomes an environment, named by the version of its first package.
# Nothing of gridfold imports from them; ANDES keeps the code that it generates in its own.
$(PEERS)/.ready: benchmarks/peers/requirements.txt
	rm -rf $(PEERS)
	grep -v '^#' $< | while read -r tool others; do \
		home="$(CURDIR)/$(PEERS)/$${tool#*==}"; \
		$(PYTHON) -m venv "$$home" && \
		"$$home/bin/pip" install --quiet "$$tool" $$others && \
		HOME="$$home" "$$home/bin/andes" prep >/dev/null || exit 1; \
	done
	touch $@
