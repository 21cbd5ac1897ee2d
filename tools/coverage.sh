#!/bin/sh
# Line and branch coverage of the firmware core by its unit tests: prints a table, fails below 100 %.
# Branches that only the compiler adds for exceptions do not count; the core has none.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
out=$root/build/coverage
mkdir -p "$out"
cat >"$out/Makefile" <<'MAKE'
CXXFLAGS := -std=c++17 -O0 -g --coverage -fno-exceptions -I$(ROOT)/firmware/src/core
CORE := $(wildcard $(ROOT)/firmware/src/core/*.cpp)
TEST := $(wildcard $(ROOT)/firmware/test/test_core/*.cpp)
HEADERS := $(wildcard $(ROOT)/firmware/src/core/*.h $(ROOT)/firmware/test/test_core/*.h)
OBJECTS := $(patsubst $(ROOT)/firmware/src/core/%.cpp,core_%.o,$(CORE)) \
  $(patsubst $(ROOT)/firmware/test/test_core/%.cpp,test_%.o,$(TEST))
suite: $(OBJECTS)
	$(CXX) --coverage -o $@ $^
core_%.o: $(ROOT)/firmware/src/core/%.cpp $(HEADERS)
	$(CXX) $(CXXFLAGS) -c -o $@ $<
test_%.o: $(ROOT)/firmware/test/test_core/%.cpp $(HEADERS)
	$(CXX) -std=c++17 -O0 -w -I$(ROOT)/firmware/src/core -I/usr/include/doctest -c -o $@ $<
MAKE
make -s -j2 -C "$out" ROOT="$root" suite
rm -f "$out"/*.gcda
"$out/suite" -s=false --no-version >/dev/null
cd "$out"
gcov --branch-counts --branch-probabilities --json-format --stdout core_*.gcda |
  python3 "$root/tools/coverage_table.py"
