# armctl: everything a newcomer needs. `make run` starts it, `make test` proves it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
BENCH := build/bench-venv
SOURCES := src tests benchmarks examples docs
# Tests start hundreds of processes: where Python may not keep what it compiles, each compiles all of armctl anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test check format docs docs-serve pictures bench bench-live clean

run: $(VENV)/.installed
	@$(BIN)/armctl serve $(ARGS)

# Three workers on two cores: two drive a browser each and mostly wait for it; the third does the rest. With four,
# boards that tests simulate answer too late, and Enable is refused. The simulated CPUs, C code in the same process,
# come first, beside the checks: what they may do to memory harms no other test. What is installed for them needs
# the network here and there: side by side, too.
test: | $(BIN)/python
	@$(MAKE) --no-print-directory -j2 $(VENV)/.tested packages
	@$(MAKE) --no-print-directory -j2 check avr collected
	$(BIN)/pytest -n 3 --ignore=tests/avr --durations=40 $(ARGS)

.PHONY: avr
avr: $(VENV)/.tested packages
	@$(BIN)/python -m tests.avr.building
	$(BIN)/pytest -n 2 tests/avr

# Once, on the core that is free first: pytest keeps the tests compiled, and no worker does that again.
.PHONY: collected
collected: $(VENV)/.tested
	@-$(BIN)/pytest --collect-only -qq --ignore=tests/avr >/dev/null

check: $(VENV)/.tested
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/basedpyright
	$(BIN)/lint-imports

format: $(VENV)/.tested
	$(BIN)/ruff check --fix $(SOURCES)
	$(BIN)/ruff format $(SOURCES)

# The docs site, into build/site; a warning is an error. `make docs-serve` shows it at localhost:8000.
docs: $(VENV)/.documented
	$(BIN)/python docs/build.py $(ARGS)

docs-serve: $(VENV)/.documented
	$(BIN)/python docs/build.py --serve

# Every picture of README and docs, from the running product.
pictures: $(VENV)/.tested packages
	$(BIN)/python docs/figures.py
	$(BIN)/python -m docs.pictures $(ARGS)

# The peers live in an environment of their own; one that does not install is named in the table.
bench: $(BENCH)/.installed
	$(BENCH)/bin/python -m benchmarks $(ARGS)

# What a user waits for, with the product running; best on a machine that does nothing else.
bench-live: $(VENV)/.installed
	$(BIN)/python -m benchmarks.end_to_end $(ARGS)

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo 'armctl needs Python 3.11 or newer; name one with: make PYTHON=python3.12 ...' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null \
	  || if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; \
	     then apt-get update -qq && apt-get install -y -qq python3-venv; \
	     else echo 'Python cannot make environments here; install them first: sudo apt-get install python3-venv' >&2; exit 1; fi
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	@echo 'installing armctl into $(VENV) (once) ...'
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/.documented: pyproject.toml $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable . --group docs
	@touch $@

# Not compiled: half a minute on one core for thousands of modules that no test imports; the others are when first used.
$(VENV)/.tested: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --no-compile --editable . --group test
	@touch $(VENV)/.installed $@

$(BENCH)/.installed: pyproject.toml benchmarks/peers.txt | $(BIN)/python
	$(PYTHON) -m venv $(BENCH)
	$(BENCH)/bin/python -m pip install --quiet --upgrade pip
	$(BENCH)/bin/python -m pip install --quiet --editable .
	@echo 'installing the peers into $(BENCH) (once, about 1 GB) ...'
	@$(BENCH)/bin/python -m pip install --quiet -r benchmarks/peers.txt \
	  || for peer in $$(grep -v '^#' benchmarks/peers.txt); do \
	       $(BENCH)/bin/python -m pip install --quiet "$$peer" || echo "$$peer does not install here" >&2; done
	@touch $@

# What the tests need and pip does not have: browsers (playwright's downloads are not needed), what its driver and
# other wheels with node inside are linked with, and simavr with compilers for real firmware on a simulated CPU.
BROWSER := chromium-headless-shell fonts-dejavu-core fonts-liberation libatomic1
OTHERS := firefox-esr webkit2gtk-driver xvfb
AVR := simavr libsimavr-dev libelf-dev gcc libc6-dev gcc-avr avr-libc arduino-core-avr pkg-config make
.PHONY: packages
packages:
	@missing=; \
	 for one in chromium-headless-shell chromium chromium-browser google-chrome; do \
	   command -v $$one >/dev/null && break; done || missing='$(BROWSER)'; \
	 { command -v firefox-esr && command -v WebKitWebDriver && command -v Xvfb; } >/dev/null \
	   || missing="$$missing $(OTHERS)"; \
	 { command -v gcc && command -v avr-gcc && command -v pkg-config && pkg-config --cflags --libs simavr \
	   && test -d /usr/share/arduino/hardware/arduino/avr; } >/dev/null 2>&1 || missing="$$missing $(AVR)"; \
	 if [ -z "$$missing" ]; then :; \
	 elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; \
	 then echo "installing $$missing for the tests ..."; apt-get update -qq \
	      && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $$missing >/dev/null; \
	 else echo "The tests need packages; install them first: sudo apt-get install $$missing" >&2; exit 1; fi
