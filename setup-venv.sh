#!/bin/sh
# Make the virtual environment named by the first argument, with the pinned dependencies and this project in it.
set -eu
venv=$1
python=${PYTHON:-python3}

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "Python 3.11 or newer is needed; $python is $("$python" --version 2>&1). Try: make PYTHON=python3.11" >&2
    exit 1
}
# A bare Debian keeps venv's own installer in a package of its own.
if ! "$python" -c 'import ensurepip' 2>/dev/null; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        apt-get update -qq && apt-get install -y -qq python3-venv
    else
        echo "Python's venv is incomplete here. Run: sudo apt-get install python3-venv" >&2
        exit 1
    fi
fi
"$python" -m venv "$venv"
# Byte code is made of what is imported; of everything it would take longer than the rest.  Nothing without a known hash
# is installed, nor is what builds this project: setuptools is among the requirements.  All that these need is among them,
# and pip does not look for it: it would take a newer release of a package with an extra, which has no hash here.
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile --require-hashes --no-deps \
    --only-binary=:all: --requirement requirements.txt
# Strict: real files under the name of the package, for type checkers, coverage and doctests too.
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation \
    --config-settings editable_mode=strict --editable .
