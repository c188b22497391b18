# make demo: install and see it work.   make test: everything that does not run for minutes.
# make check: what needs no run.
PYTHON ?= python3
BIN := .venv/bin

# An older interpreter or a missing ensurepip fails here, in words, before pip says it in fifty lines.
define CHECK_PYTHON
import sys
name = "%d.%d" % sys.version_info[:2]
if sys.version_info < (3, 11):
    sys.exit("f3t-skin needs Python 3.11 or newer; $(PYTHON) is %s. Choose one: make PYTHON=python3.12" % name)
import importlib.util, subprocess
if importlib.util.find_spec("ensurepip") is None:
    subprocess.call([".ci/debian-packages", "python%s-venv" % name])
    importlib.invalidate_caches()
    if importlib.util.find_spec("ensurepip") is None:
        sys.exit("$(PYTHON) cannot make a virtual environment: sudo apt-get install python%s-venv" % name)
endef
export CHECK_PYTHON

.PHONY: help install demo docs reference links check test test-long test-versions lock bench lint clean

help:
	@echo "make demo       a simulated skin, no hardware needed; into .venv, the core and plots alone (PYTHON=python3)"
	@echo "make install    a virtual environment in .venv, with everything the tests need"
	@echo "make docs       the site into build/docs, with the output of all examples, kept until code changes; a warning is an error"
	@echo "make reference  the tables of docs/reference, which the program knows"
	@echo "make links      the links of the site to other sites: are they there? (needs the net)"
	@echo "make check      ruff, types, doctests, imports, rules for code"
	@echo "make test       all tests but the long ones"
	@echo "make test-long  the long ones, the site among them, and make test-versions"
	@echo "make test-versions  with the oldest versions of all packages, and with the newest"
	@echo "make lock       renew constraints.txt, the versions that make install takes"
	@echo "make bench      the benchmarks: error beside time"
	@echo "make lint       ruff, check and format"
	@echo "make clean      remove .venv and everything built"

install: .venv/installed

.venv/bin/python:
	@command -v $(PYTHON) >/dev/null || { echo "f3t-skin needs Python 3.11 or newer; there is no $(PYTHON). Choose one: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c "$$CHECK_PYTHON"
	$(PYTHON) -m venv .venv

define PIP
$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e '.[$(1)]' \
|| { echo "The versions of constraints.txt do not fit this Python: the newest ones are installed."; \
$(BIN)/python -m pip install --disable-pip-version-check -e '.[$(1)]'; }
@touch $@
endef

.venv/demo: pyproject.toml constraints.txt | .venv/bin/python
	$(call PIP,plot)

.venv/installed: pyproject.toml constraints.txt | .venv/bin/python
	$(call PIP,test)

demo: .venv/demo
	$(BIN)/skin demo

docs: install
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d build/doctrees docs build/docs
	@echo "build/docs/index.html"

reference: install
	$(BIN)/python -m docs.site.reference

links: install
	$(BIN)/python -m sphinx -W --keep-going -q -b linkcheck -D run_examples=0 docs build/links
	@echo "build/links/output.txt"

check: install
	$(BIN)/python -m tests.house

test: install
	@.ci/debian-packages
	@$(BIN)/python -m tests.house.run

test-long: install
	@.ci/debian-packages
	$(MAKE) test-versions; versions=$$?; \
	$(BIN)/python -m pytest -m long; tests=$$?; exit $$((tests ? tests : versions))

# The oldest versions that pyproject.toml declares, and the newest that there are.
test-versions: install
	$(BIN)/python -m tests.house.versions test

lock: install
	$(BIN)/python -m tests.house.versions lock

bench: install
	$(BIN)/python -m benchmarks

lint: install
	$(BIN)/ruff check
	$(BIN)/ruff format --check

clean:
	rm -rf .venv build dist .pytest_cache .hypothesis .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
