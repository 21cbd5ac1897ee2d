#!/bin/sh
# Static analysis of the firmware: clang-tidy (firmware/.clang-tidy) and cppcheck with its MISRA addon
# (firmware/cppcheck.txt). Every finding fails that is not listed there with its reason.
set -eu
cd "$(dirname "$0")/.."
core=firmware/src/core
boards=firmware/src/boards

tidy() {
  echo "clang-tidy: $1"
  shift
  clang-tidy --quiet --config-file=firmware/.clang-tidy "$@" 2>&1 |
    { ! grep -v -e '^[0-9]* warnings\{0,1\} generated' -e '^Suppressed ' -e '^Use -header-filter'; }
}

# avr-libc's watchdog header and the start-up code without a frame are more than clang's front end for
# the AVR takes: the analysis does without both.
avr() {
  tidy "$1" "$boards/atmega/atmega.cpp" "$boards/atmega/main.cpp" "$boards/$1/board.cpp" -- -x c++ \
    -std=c++14 -fno-exceptions --target=avr "-mmcu=$2" -isystem /usr/lib/avr/include \
    -D__STDC_LIMIT_MACROS -DF_CPU=16000000L "-D$3" -Dnaked= -D_AVR_WDT_H_ \
    '-Dwdt_reset()=((void)0)' '-Dwdt_disable()=((void)0)' "-I$core"
}

tidy core "$core"/*.cpp firmware/src/desk/target.cpp -- -x c++ -std=c++14 -fno-exceptions "-I$core"
avr uno atmega328p DARANTI_BOARD_UNO
avr mega2560 atmega2560 DARANTI_BOARD_MEGA2560
echo "cppcheck"
cppcheck --quiet --error-exitcode=1 --std=c++14 --language=c++ \
  --enable=warning,style,performance,portability --addon=misra \
  --suppressions-list=firmware/cppcheck.txt --suppress=missingIncludeSystem --inline-suppr \
  -DF_CPU=16000000L -DDARANTI_BOARD_UNO -D__AVR_ATmega328P__ -U__AVR__ "-I$core" firmware/src
