# armctl: everything a newcomer needs. `make run` starts it, `make test` proves it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
BENCH := build/bench-venv
SOURCES := src tests benchmarks examples docs

.PHONY: run test check format docs docs-serve pictures bench bench-live clean

run: $(VENV)/.installed
	@$(BIN)/armctl serve $(ARGS)

# Three workers on two cores: two drive a browser each and mostly wait for it; the third does the rest. The
# simulated CPUs, C code in the same process, come first and alone: what they may do to memory harms no other test.
test: $(VENV)/.tested browser node avr check
	$(BIN)/pytest -n 2 tests/avr
	$(BIN)/pytest -n 3 --ignore=tests/avr --durations=40 $(ARGS)

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
pictures: $(VENV)/.tested browser
	$(BIN)/python docs/figures.py
	$(BIN)/python -m docs.pictures $(ARGS)

# The peers live in an environment of their own; one that does not install is named in the table.
bench: $(BENCH)/.installed
	$(BENCH)/bin/python -m benchmarks $(ARGS)

# What a user waits for, with the product running; best on a machine that does nothing else.
bench-live: $(VENV)/.installed
	$(BIN)/python -m benchmarks.end_to_end $(ARGS)

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis test-artifacts

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

$(VENV)/.tested: pyproject.toml $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable . --group test
	@touch $@

$(BENCH)/.installed: pyproject.toml benchmarks/peers.txt | $(BIN)/python
	$(PYTHON) -m venv $(BENCH)
	$(BENCH)/bin/python -m pip install --quiet --upgrade pip
	$(BENCH)/bin/python -m pip install --quiet --editable .
	@echo 'installing the peers into $(BENCH) (once, about 1 GB) ...'
	@$(BENCH)/bin/python -m pip install --quiet -r benchmarks/peers.txt \
	  || for peer in $$(grep -v '^#' benchmarks/peers.txt); do \
	       $(BENCH)/bin/python -m pip install --quiet "$$peer" || echo "$$peer does not install here" >&2; done
	@touch $@

# The browser tests drive a real browser. Debian's own is used; playwright's download is not needed.
.PHONY: browser
browser:
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null \
	  || if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; \
	     then echo 'installing chromium for the browser tests ...'; \
	          apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq chromium fonts-dejavu-core; \
	     else echo 'The browser tests need chromium; install it first: sudo apt-get install chromium' >&2; exit 1; fi

# The example of the WebSocket API in another language.
.PHONY: node
node:
	@node -e 'Number(process.versions.node.split(".")[0]) >= 20 || require("ws")' >/dev/null 2>&1 \
	  || if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; \
	     then echo 'installing nodejs for the test of the JavaScript example ...'; \
	          apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends nodejs node-ws; \
	     else echo 'The JavaScript example needs node; install it first: sudo apt-get install nodejs node-ws' >&2; exit 1; fi

# Real firmware on a simulated CPU: simavr, the compilers, and a firmware image that others built.
AVR_PACKAGES := simavr libsimavr-dev libelf-dev gcc libc6-dev gcc-avr avr-libc arduino-core-avr pkg-config make
.PHONY: avr
avr: $(VENV)/.tested
	@missing=; \
	 { command -v gcc && command -v avr-gcc && command -v pkg-config && pkg-config --cflags --libs simavr \
	   && test -d /usr/share/arduino/hardware/arduino/avr; } >/dev/null 2>&1 || missing='$(AVR_PACKAGES)'; \
	 command -v npm >/dev/null || test -e build/avr/StandardFirmata.mega.hex || missing="$$missing npm"; \
	 if [ -z "$$missing" ]; then :; \
	 elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; \
	 then echo "installing $$missing for the firmware tests ..."; \
	      apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $$missing; \
	 else echo "The firmware tests need a simulated board; install it first: sudo apt-get install $$missing" >&2; exit 1; fi
	@$(BIN)/python -m tests.avr.building
