#!/usr/bin/env bash
# Regenerates requirements.lock from pyproject.toml: the newest versions of the
# run-time and dev dependencies, with the hashes of every platform's files.
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

# No addresses in the lock: whoever installs it chooses the index. Only wheels,
# because set-up must not need a compiler.
"$uv" pip compile --quiet --upgrade --universal --python-version 3.12 \
  --only-binary :all: --generate-hashes \
  --no-emit-index-url --no-emit-find-links --no-header --no-annotate \
  --extra dev --output-file requirements.lock pyproject.toml >/dev/null
say "requirements.lock written: read the difference, then run ./test.bash."
