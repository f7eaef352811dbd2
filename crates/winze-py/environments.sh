# Virtual environments under target/python, for `check` and `wheels`; both are in the project's root by then.

crate=crates/winze-py
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
export CARGO_TARGET_DIR=$target
kept=$target/python
export PIP_DISABLE_PIP_VERSION_CHECK=1

# suits PYTHON: whether it is one that winze runs on and that makes virtual environments.
suits() { "$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))' >/dev/null 2>&1; }

python=${PYTHON:-python3}
if ! suits "$python"; then
    echo "$python: Python 3.10 or later with venv is wanted: apt-get install python3 python3-venv, or name one in PYTHON" >&2
    exit 1
fi

# environment NAME PYTHON FILE...: leaves it in $kept/NAME, with what requirements/FILE.txt list. It is made anew only where these
# or the Python are others than last time.
environment() {
    local at=$kept/$1 python=$2 asked=() file made_of
    for file in "${@:3}"; do asked+=("$crate/requirements/$file.txt"); done
    made_of=$("$python" -c 'import sys; print(sys.base_prefix, sys.version)' && cat "${asked[@]}" "$crate/requirements/locked.txt")
    if [ "$(cat "$at/made-of" 2>/dev/null)" != "$made_of" ]; then
        "$python" -m venv --clear "$at"
        "$at/bin/python" -m pip install --quiet --no-compile --only-binary :all: "${asked[@]/#/--requirement=}" --constraint "$crate/requirements/locked.txt"
        echo "$made_of" >"$at/made-of"
    fi
}
