# Daranti. `make harvest` and `make test` set up all they need and then do their job.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out/harvest
FIRMWARE ?= desk

DESK := .pio/build/desk/libdaranti.so
BOARDS := $(patsubst %,.pio/build/%/firmware.elf,uno uno_hil nano mega2560)
SHIM := build/simavr/libdaranti_avr.so
SOURCES := $(wildcard firmware/src/*.* firmware/src/*/*.* firmware/src/*/*/*.* firmware/scripts/*) platformio.ini

# Byte code is kept: what is read anew by each worker takes a fifth of the quick tests.
unexport PYTHONDONTWRITEBYTECODE
# Each process begins with a half of its own, so that a file's fixtures are made once. Who is done first
# takes over some of the other's tests: the pages in a browser, a tenth of it all, lie near the end.
PARALLEL := -n 2 --dist worksteal
# Tests run in as many processes as there are cores: threads below them only wait for each other.
check test test-long mutants-python: export OPENBLAS_NUM_THREADS = 1

.DEFAULT_GOAL := help
.PHONY: help setup build harvest test test-firmware test-wallclock test-long lint analyse compiled mutants mutants-python mutants-board speed clean check
.DELETE_ON_ERROR:

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.setup/debian: tools/debian.sh
	@./tools/debian.sh
	@mkdir -p .setup && touch $@

.setup/venv: pyproject.toml | .setup/debian
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing Python packages into $(VENV)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@mkdir -p .setup && touch $@

.setup/platformio: tools/seed_platformio.py | .setup/venv
	@$(BIN)/python tools/seed_platformio.py
	@mkdir -p .setup && touch $@

$(DESK): $(SOURCES) | .setup/platformio
	@$(BIN)/pio run --silent -e desk
	@touch $@

$(BOARDS): .pio/build/%/firmware.elf: $(SOURCES) | .setup/platformio
	@$(BIN)/pio run --silent -e $*
	@touch $@

$(SHIM): $(wildcard hil/firmware/simavr/*) firmware/src/target.h | .setup/debian
	@$(MAKE) --no-print-directory -s -C hil/firmware/simavr

build: $(DESK) $(BOARDS) $(SHIM) ## builds the firmware for the desk and every board, and the simulator's shim

setup: .setup/venv build ## everything that the other commands need

harvest: setup ## commissions the machine, then harvests the default field with the compiled firmware in the loop (FIRMWARE=avr for the Uno's binary)
	@$(BIN)/daranti-hil commission --out $(OUT)-belief
	@$(BIN)/daranti-hil harvest --firmware $(FIRMWARE) --belief $(OUT)-belief --out $(OUT)

lint: setup ## formatting, style, types and layers
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy && $(BIN)/lint-imports
	@$(BIN)/clang-format --dry-run --Werror $$(git ls-files 'firmware/*.h' 'firmware/*.cpp' 'hil/firmware/simavr/*.cpp' 'sim_plant/*.cpp' 'tools/*.h' 'tools/*.cpp')
	@$(BIN)/python tools/protogen.py --check && $(BIN)/python tools/statechart.py --check && $(BIN)/python tools/safety_case.py --check && $(BIN)/python tools/figures.py write --check

analyse: setup ## static analysis of the firmware: clang-tidy (CERT, bugprone), cppcheck with MISRA (half a minute)
	@./tools/analyse.sh

check: lint ## for the hand that changes a line: style, types, layers, the firmware's unit tests, the quick tests (a minute)
	@$(BIN)/pio test -e native
	@$(BIN)/python -m pytest $(PARALLEL) -q -m "not slow and not long and not wallclock"

test-firmware: setup
	@$(BIN)/pio test -e native

# Numba's cache, for two workers that would otherwise compile the same at the same time.
compiled: setup
	@$(BIN)/python tools/precompile.py

# What takes one core each goes on side by side; the longest first.
test: setup ## every test: firmware on the desk and in simavr, host, plant and bench, and static analysis
	@$(MAKE) --no-print-directory -j2 --output-sync=target compiled lint analyse test-firmware
	@$(BIN)/python -m pytest $(PARALLEL) -q
	-@$(BIN)/python tools/speed.py --rounds 4 --drives 1

speed: setup ## what each part of the bench costs, against the stored baseline
	@$(BIN)/python tools/speed.py

mutants: setup ## mutation testing of the firmware core (a few minutes)
	@$(BIN)/python tools/mutate.py

mutants-python: setup ## breaks the Python code, one line a time, and runs the tests that must notice (half an hour)
	@$(BIN)/python tools/mutate_python.py

mutants-board: setup ## mutation testing of the boards' code in simavr (ten minutes)
	@$(BIN)/python tools/mutate_board.py

test-wallclock: setup ## drives the machine behind a virtual serial port in real time (90 s, on a quiet machine)
	@$(BIN)/python -m pytest -q -m wallclock

test-long: setup ## campaigns of 200 runs killed and resumed, 50 records killed at random, the default harvest in wall-clock time, new examples for every property (over an hour)
	@$(BIN)/python -m pytest -q -m long
	@HYPOTHESIS_PROFILE=explore $(BIN)/python -m pytest $(PARALLEL) -q

clean: ## removes what was built, not the virtual environment
	rm -rf build out .pio .setup
