#!/usr/bin/env bash
# Regenerates the locks from pyproject.toml, with the hashes of every platform's files:
# requirements.lock has the newest versions of the run-time and dev dependencies,
# requirements-run.lock those of them that running takes, for companion boards, and
# requirements-uv.lock has what installs them.
set -euo pipefail
cd "$(dirname "$0")/.."
source tools/setup.bash

if type -P uv >/dev/null; then
  uv=uv
else
  find_python
  scratch=$(mktemp -d)
  trap 'rm -rf "$scratch"' EXIT
  "$python" -I -m venv "$scratch"
  "$scratch/bin/python" -I -m pip install --quiet --disable-pip-version-check uv
  uv=$scratch/bin/uv
fi

# No addresses in the locks: whoever installs them chooses the index. Only wheels,
# because set-up must not need a compiler.
compile() {
  "$uv" pip compile --quiet --upgrade --universal --python-version 3.12 \
    --only-binary :all: --generate-hashes \
    --no-emit-index-url --no-emit-find-links --no-header --no-annotate \
    "$@" >/dev/null
}
compile --extra dev --output-file requirements.lock pyproject.toml
compile --constraint requirements.lock --output-file requirements-run.lock pyproject.toml
compile --output-file requirements-uv.lock - <<<uv
say "all locks written: read the difference, then run ./test.bash."
