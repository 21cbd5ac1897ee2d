#!/bin/sh
# Fuzzes the frame parser under ASan and UBSan; arguments: how many inputs (10000000), seed (1).
# With clang's libFuzzer the coverage guides the inputs, from the golden frames on; without it they
# are random.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
runs=${1:-10000000}
seed=${2:-1}
out=$root/build/fuzz
mkdir -p "$out/corpus"
common="-std=c++17 -O2 -g -I$root/firmware/src"
sources="$root/tools/fuzz_parser.cpp $root/firmware/src/frame.cpp"
# shellcheck disable=SC2086
if clang++ $common -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all \
  -o "$out/parser" $sources 2>"$out/clang.log"; then
  python3 - "$root/firmware/test/golden_frames.txt" "$out/corpus" <<'PY'
import pathlib
import sys

for line in pathlib.Path(sys.argv[1]).read_text().splitlines():
    if line and not line.startswith("#"):
        name, *_, frame = line.split()
        (pathlib.Path(sys.argv[2]) / name).write_bytes(bytes.fromhex(frame))
PY
  exec "$out/parser" -runs="$runs" -seed="$seed" -max_len=96 -print_final_stats=1 \
    -verbosity=1 "$out/corpus"
fi
if command -v clang++ >/dev/null; then
  echo "fuzz.sh: clang++ has no libFuzzer here ($out/clang.log);" >&2
else
  echo "fuzz.sh: clang++ is not installed;" >&2
fi
echo "fuzz.sh: random inputs instead. For guided ones: apt-get install clang libclang-rt-14-dev" >&2
# shellcheck disable=SC2086
g++ $common -fsanitize=address,undefined -fno-sanitize-recover=all -o "$out/parser" $sources \
  "$root/tools/fuzz_random.cpp"
exec "$out/parser" "$runs" "$seed"
