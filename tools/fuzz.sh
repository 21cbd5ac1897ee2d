#!/bin/sh
# Fuzzes the frame parser under ASan and UBSan; arguments: how many inputs (10000000), seed (1).
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$root/build/fuzz"
g++ -std=c++17 -O2 -fsanitize=address,undefined -fno-sanitize-recover=all -I"$root/firmware/src" \
  -o "$root/build/fuzz/parser" "$root/tools/fuzz_parser.cpp" "$root/firmware/src/frame.cpp"
"$root/build/fuzz/parser" "$@"
