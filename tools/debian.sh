#!/bin/sh
# Installs the Debian packages that the project needs and that are missing, or says which.
set -eu
packages="gcc-avr avr-libc arduino-core-avr avrdude libsimavr-dev libelf-dev doctest-dev clang-tidy cppcheck chromium"
python3 -c 'import ensurepip, venv' 2>/dev/null || packages="$packages python3-venv"
command -v g++ >/dev/null || packages="$packages g++"
missing=
for package in $packages; do
  status=$(dpkg-query -W -f '${Status}' "$package" 2>/dev/null || true)
  [ "$status" = "install ok installed" ] || missing="$missing $package"
done
[ -n "$missing" ] || exit 0
if [ "$(id -u)" = 0 ]; then
  as_root=
elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
  as_root="sudo -n"
else
  echo "missing Debian packages:$missing" >&2
  echo "as an administrator run: apt-get update && apt-get install --no-install-recommends$missing" >&2
  exit 1
fi
echo "installing Debian packages:$missing"
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
if ! { $as_root apt-get update -q && $as_root apt-get install -q -y --no-install-recommends $missing; } >"$log" 2>&1; then
  tail -n 20 "$log" >&2
  echo "apt-get could not install:$missing (its last lines are above)" >&2
  exit 1
fi
rm -f "$log"
