#!/bin/sh
# Look for what only the system can provide, and name the command that installs it.
PYTHON=${PYTHON:-python3}
missing=
fail() { echo "handwave: $1" >&2; exit 1; }
command -v "$PYTHON" >/dev/null 2>&1 || fail "$PYTHON is missing; install it: sudo apt-get install python3 python3-venv"
"$PYTHON" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' ||
    fail "$("$PYTHON" --version) cannot be used, Python 3.10 to 3.13 can: make setup PYTHON=python3.12 (sudo apt-get install python3.12-venv)"
"$PYTHON" -c 'import ensurepip, venv' 2>/dev/null || missing="$missing python3-venv"
for pair in "c++ g++" "cmake cmake" "make make"; do
    command -v "${pair% *}" >/dev/null 2>&1 || missing="$missing ${pair#* }"
done
header=$("$PYTHON" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h
[ -f "$header" ] || missing="$missing python3-dev"
[ -z "$missing" ] || fail "missing:$missing; install with: sudo apt-get install$missing"
machine=$(uname -m)
[ "$machine" = x86_64 ] ||
    fail "ROS 2 from PyPI exists for x86_64, this is $machine; use an ordinary ROS 2 Jazzy installation and colcon build (README, Platforms)"
[ -n "${HOME:-}" ] || fail "HOME is not set; ROS 2 writes its logs below it: export HOME or ROS_LOG_DIR"
