#!/usr/bin/env bash
# Pin every package with its hashes, for Linux, macOS and Windows and Python 3.11 to 3.14:
#   constraints.txt       the core packages and all extras: the development environment
#   constraints-core.txt  the core packages alone, in the same versions: the wheel test
# Existing pins are kept where they still fit; `make lock UPGRADE=1` takes the newest of everything.
set -euo pipefail
cd "$(dirname "$0")/.."

tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
"${PYTHON:-python3}" -m venv "$tools"
"$tools/bin/pip" install -qq uv

# The header names `make lock` and no address, so the files are the same wherever they are made.
compile() {
    "$tools/bin/uv" --no-config pip compile pyproject.toml --quiet --universal --python-version 3.11 \
        --generate-hashes --no-emit-index-url --no-emit-find-links --no-annotate \
        --custom-compile-command "make lock" "$@" >/dev/null
}

compile --all-extras ${UPGRADE:+--upgrade} --output-file constraints.txt
rm -f constraints-core.txt
compile --constraints constraints.txt --output-file constraints-core.txt
