# Everything runs from .venv; `make demo` on a fresh machine needs only Python 3.11 to 3.13 and make.

PYTHON ?= $(shell command -v python3.11 || command -v python3.12 || command -v python3.13 || command -v python3 || echo python3.11)
BIN := .venv/bin
STAMP := .venv/.installed
EXTRAS := .venv/.extras
KERNELS := .venv/.kernels
WORKERS ?= 2
# A worker that is done takes over tests of one that is not. Byte code is kept, whatever the shell
# says: the tests start hundreds of interpreters.
PYTEST := PYTHONDONTWRITEBYTECODE= PYTHONPYCACHEPREFIX=$(CURDIR)/.venv/pycache $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal --durations=20

.PHONY: help demo test unit long check format bench docs clean

help:
	@echo "make demo    one run of the AWS hospital: picture, verdicts, report page"
	@echo "make test    all tests but the long ones"
	@echo "make unit    the quick tests"
	@echo "make long    what takes minutes and is not in make test, or one part of five of it: make long PART=3"
	@echo "make check   format, lint, types, import contracts, quick tests"
	@echo "make format  mend what ruff can mend"
	@echo "make docs    the documentation as a site, in build/site"
	@echo "make bench   speed of every layer as JSON"

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null || { \
		echo "mrta-falsify needs Python 3.11, 3.12 or 3.13; found: $$($(PYTHON) --version 2>&1)." >&2; \
		echo "Install it (for example: apt-get install python3.11-venv, or: uv python install 3.11) and run: make PYTHON=/path/to/python3.11" >&2; \
		exit 2; }
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv || { \
		echo "Python cannot make a virtual environment; on Debian or Ubuntu: apt-get install python3-venv" >&2; exit 2; }
	@echo "installing into .venv (two minutes, 1.5 GB)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

# What tests, checks and the site need beside it; the demo does without.
$(EXTRAS): $(STAMP)
	@echo "installing what tests, checks and the site need (a minute, 0.7 GB)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,dask,docs,gym,mcap,mujoco,qd,ros,video]'
	@rm -f $(KERNELS)  # an engine more has kernels, too
	@touch $@

# It compiles what has changed; after an edit of anything else it only looks, for two seconds.
$(KERNELS): $(STAMP) tools/compile_kernels.py $(shell find mrta_falsify simulator_interface -name '*.py')
	@$(BIN)/python -m tools.compile_kernels $@

demo: $(KERNELS)
	$(BIN)/mrta-falsify demo

test: $(EXTRAS) $(KERNELS)
	$(PYTEST) -m "not long and not browser"

unit: $(EXTRAS) $(KERNELS)
	$(PYTEST) -m "not slow and not long and not browser"

long: $(EXTRAS) $(KERNELS)
	$(PYTEST) -m "long or browser" $(if $(PART),--part $(PART))

check: $(EXTRAS)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(MAKE) unit

format: $(EXTRAS)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(KERNELS)
	$(BIN)/mrta-falsify bench --format json

docs: $(EXTRAS)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo build/site/index.html

clean:
	rm -rf .mypy_cache .ruff_cache .pytest_cache .hypothesis build demo-run $(KERNELS)
	find . -path ./.venv -prune -o -type d -name __pycache__ -exec rm -rf {} +
