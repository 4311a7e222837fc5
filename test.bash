#!/usr/bin/env bash
# Tests: sets up .venv beside this file when needed, then runs pytest with the
# options given, by default in three processes (-n 0 for one, to debug).
set -euo pipefail
source "$(dirname "$(readlink -f "$0")")/tools/setup.bash"

set_up "$whole"
missing=$(missing_packages drake rendering sandbox)
if [ -n "$missing" ]; then
  if [ "$(id -u)" = 0 ] && type -P apt-get >/dev/null; then
    say "installing $missing..."
    output=$(install_packages "$missing" 2>&1) || {
      printf '%s\n' "$output" >&2
      say "that failed (see above): tests that need it will fail."
    }
  else
    say "some tests will fail, or be skipped, for want of a system package: $(install_hint "$missing")."
  fi
fi

# Several test processes share the cores: with threads of their own in each,
# the numerical libraries would only wait for one another.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1

# Byte code is kept, whatever the shell has set: without it, each of the hundreds of processes that
# tests start would compile all of airrace.
unset PYTHONDONTWRITEBYTECODE

# Keeps out the packages, and pytest plugins, of whatever the shell has sourced.
unset PYTHONPATH

# The debugger needs the terminal that xdist takes away.
for option in "$@"; do
  case $option in
    -n* | --numprocesses* | --pdb | --trace) processes=chosen ;;
  esac
done
# Three on two cores: tests of links, pages and clients mostly wait.
[ -n "${processes:-}" ] || set -- -n 3 "$@"

cd "$root"
exec "$venv/bin/python" -m pytest "$@"
