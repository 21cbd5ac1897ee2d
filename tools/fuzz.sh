#!/bin/sh
# Fuzzes the firmware core on the desk under ASan and UBSan.
# usage: fuzz.sh [parser|controller] [INPUTS] [SEED]   (parser, 10000000; controller 200000; seed 1)
# With clang's libFuzzer the coverage guides the inputs, the parser's from the golden frames on;
# without it they are random.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
case ${1:-} in
  parser | controller) target=$1 && shift ;;
  *) target=parser ;;
esac
core=$root/firmware/src/core
if [ "$target" = parser ]; then
  sources=$core/frame.cpp inputs=10000000 length=96 longest=40
else
  sources=$(echo "$core"/*.cpp) inputs=200000 length=200 longest=200
fi
inputs=${1:-$inputs}
seed=${2:-1}
case $inputs$seed in
  *[!0-9]*) echo "fuzz.sh: INPUTS and SEED are numbers, not $inputs and $seed" >&2 && exit 2 ;;
esac
out=$root/build/fuzz
corpus=$out/corpus-$target
mkdir -p "$corpus"
common="-std=c++17 -O2 -g -I$core -I$root/firmware/test/test_core"
sources="$root/tools/fuzz_$target.cpp $sources"
# shellcheck disable=SC2086
if clang++ $common -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=all \
  -o "$out/$target" $sources 2>"$out/clang.log"; then
  if [ "$target" = parser ]; then
    python3 - "$root/firmware/test/golden_frames.txt" "$corpus" <<'PY'
import pathlib
import sys

for line in pathlib.Path(sys.argv[1]).read_text().splitlines():
    if line and not line.startswith("#"):
        name, *_, frame = line.split()
        (pathlib.Path(sys.argv[2]) / name).write_bytes(bytes.fromhex(frame))
PY
  fi
  exec "$out/$target" -runs="$inputs" -seed="$seed" -max_len=$length -len_control=0 -print_final_stats=1 \
    -print_funcs=0 "$corpus"
fi
if command -v clang++ >/dev/null; then
  echo "fuzz.sh: clang++ cannot build for libFuzzer here (why: $out/clang.log);" >&2
else
  echo "fuzz.sh: clang++ is not installed;" >&2
fi
echo "fuzz.sh: random inputs instead. For guided ones: apt-get install clang libclang-rt-14-dev" >&2
# shellcheck disable=SC2086
g++ $common -fsanitize=address,undefined -fno-sanitize-recover=all -o "$out/$target" $sources \
  "$root/tools/fuzz_random.cpp"
exec "$out/$target" "$inputs" "$seed" "$longest"
