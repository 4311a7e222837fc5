#!/usr/bin/env bash
# Regenerates the Python classes of airrace/lcmtypes/*.lcm with lcm-gen, which
# the package lcm brings (a dependency for development only).
set -euo pipefail
cd "$(dirname "$0")/.."

lcm_gen=$(PATH=".venv/bin:$PATH" type -P lcm-gen) || {
  echo "airrace: lcm-gen is missing; run ./test.bash once, which installs it." >&2
  exit 2
}
"$lcm_gen" --python --ppath . airrace/lcmtypes/*.lcm
