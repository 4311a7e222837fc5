#!/usr/bin/env bash
# Races: sets up .venv beside this file when needed, then runs the race with
# the options given (--help lists them).
set -euo pipefail
source "$(dirname "$(readlink -f "$0")")/tools/setup.bash"

set_up "$running"
missing=$(missing_packages drake)
[ -z "$missing" ] || die "Drake needs a system library: $(install_hint "$missing")."

# The working directory stays the caller's: relative paths among the options
# mean what was typed.
exec "$venv/bin/python" -P -m airrace race "$@"
