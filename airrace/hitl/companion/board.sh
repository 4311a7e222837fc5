# What airrace does on a companion computer. The workstation sends this text over ssh, as the
# standard input of one of
#
#   sh -s inspect ENVIRONMENT PACKAGE
#   sh -s set_up ENVIRONMENT PACKAGE PYTHON KILOBYTES ONLINE|OFFLINE
#   sh -s run FOLDER UDP_PORT PYTHON
#   sh -s stop FOLDER SECONDS
#
# ENVIRONMENT and PACKAGE are digests of the lock and of airrace's files. What it says to the
# workstation are lines that begin with "airrace-"; {host} and {said} in them are filled in
# there: {said} is the last line of a program's output. The exit code is 2 after a refusal.

cache=${XDG_CACHE_HOME:-$HOME/.cache}/airrace
# A command that ssh runs sees less of PATH than a login does: uv and its links are here.
PATH=$PATH:$HOME/.local/bin:$HOME/.cargo/bin

say() { printf 'airrace-%s: %s\n' "$1" "$2"; }

free_kilobytes() { df -Pk "$cache" | awk 'NR == 2 { print $4 }'; }

refuse() {
  # Not every program says that it fails for want of room.
  [ ! -d "$cache" ] || [ "$(free_kilobytes)" -gt 20000 ] || echo 'No space left on device'
  say refused "$1"
  exit 2
}

# An environment or a package is complete when this file is in it, which is written last. Its
# time says when it was last used.
is_complete() { [ -e "$1/complete" ]; }

is_environment() {
  is_complete "$1" && "$1/bin/python" -I -c '
import importlib.util, sys
sys.exit(importlib.util.find_spec("pydrake") is None)' 2>/dev/null </dev/null
}

# The same rules as in tools/setup.bash: CPython 3.12 to 3.14, with venv and pip, not
# free-threaded.
is_suitable() {
  "$1" -I -c '
import ensurepip, sys, sysconfig, venv
assert (3, 12) <= sys.version_info[:2] < (3, 15)
assert sys.implementation.name == "cpython"
assert not sysconfig.get_config_var("Py_GIL_DISABLED")
print("airrace-python:", sys.executable)
' 2>/dev/null </dev/null
}

find_python() {
  for python in python3.12 python3.13 python3.14 python3 \
    "${PYENV_ROOT:-$HOME/.pyenv}"/versions/*/bin/python; do
    is_suitable "$python" && return
  done
  if command -v uv >/dev/null; then
    is_suitable "$(uv python find --system '>=3.12,<3.15' 2>/dev/null </dev/null)" && return
    remedy="run 'uv python install 3.12' there"
  else
    remedy="install uv there (https://docs.astral.sh/uv) and run 'uv python install 3.12' there"
  fi
  refuse "There is no Python 3.12, 3.13 or 3.14 with venv on {host}; $remedy."
}

inspect() {
  say cache "$cache"
  machine="$(uname -s) $(uname -m)"
  case $machine in
    'Linux aarch64' | 'Linux x86_64' | 'Linux arm64') ;;
    *) refuse "{host} is $machine, for which Drake has no wheels; use one with 64-bit Linux." ;;
  esac
  is_environment "$cache/environments/$1" && say environment there
  is_complete "$cache/packages/$2" && say package there
  find_python
  exit 0
}

set_up() {
  environment=$cache/environments/$1
  # All programs of a set-up end when the connection is lost: then the input ends.
  exec 3<&0 8>>"$cache/set_up.lock"
  (cat <&3 >/dev/null 2>&1; kill -s KILL 0) 8>&- >/dev/null 2>&1 &
  exec 3<&- </dev/null
  flock -n 8 || {
    say step 'waiting for another set-up there'
    flock 8
  }
  is_environment "$environment" || make_environment "$1" "$3" "$4" "$5"
  touch "$environment/complete"
  touch "$cache/packages/$2/complete"
  remove_unused
  rm -rf "$cache/wheelhouse/$1"
}

make_environment() {
  lock=$cache/locks/$1.txt
  [ "$(free_kilobytes)" -ge "$3" ] || {
    echo 'No space left on device'
    exit 2
  }
  say step "making an environment with $2"
  "$2" -I -m venv --clear "$environment" 2>&1 || refuse "Python on {host} cannot make virtual \
environments ({said}); run there 'sudo apt-get install python3-venv'."
  say step 'installing requirements-run.lock'
  if [ "$4" = OFFLINE ]; then
    set -- --no-index --find-links "$cache/wheelhouse/$1"
    remedy='have a wheel of every locked package for it in the folder of --wheels'
  else
    set --
    remedy='connect it to the internet, or bring the wheels along with --wheels'
  fi
  "$environment/bin/python" -I -m pip install --no-input --disable-pip-version-check \
    --no-cache-dir --progress-bar off --only-binary :all: --require-hashes "$@" \
    --requirement "$lock" 2>&1 ||
    refuse "Installing requirements-run.lock on {host} failed ({said}); $remedy."
  error=$("$environment/bin/python" -I -c 'import pydrake.common' 2>&1) || {
    echo "$error"
    case $error in
      *libglib-2.0*) library=libglib2.0-0 ;;
      *) library='what the message names' ;;
    esac
    refuse "Drake cannot be imported on {host} ({said}); install $library there with \
'sudo apt-get install'."
  }
}

# Removes what was not used for 60 days.
remove_unused() {
  for entry in "$cache"/environments/* "$cache"/packages/* "$cache"/runs/*; do
    used=$entry
    is_complete "$entry" && used=$entry/complete
    [ -n "$(find "$used" -maxdepth 0 -mtime +60 2>/dev/null)" ] && rm -rf "$entry"
  done
}

# Runs FOLDER/command and prints its output, which is kept in FOLDER/output/autonomy.log, too.
# When the connection is lost it runs on: it ends by itself when the simulation is silent.
run() {
  cd "$1" || exit
  exec 9>>"$cache/run.lock"
  flock -n 9 || refuse "Another race's autonomy is running on {host}; end that race, or run \
there 'kill $(cat "$cache/run.pid")'."
  if [ "$2" -gt 0 ]; then
    "$3" -I -c '
import socket, sys
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as LCM does
    s.bind(("", int(sys.argv[1])))
' "$2" 2>&1 || refuse "UDP port $2 is in use on {host} ({said}); end what uses it there, or \
name another port in --lcm_url."
  fi
  trap '' HUP
  mkdir -p output
  setsid sh ./command >output/autonomy.log 2>&1 </dev/null &
  group=$!
  echo $group >pid
  echo $group >"$cache/run.pid"
  say running "$group"
  exec 2>/dev/null
  tail -s 0.05 -n +1 -F --pid=$group output/autonomy.log 9>&- &
  wait $group
  code=$?
  # Workers that it leaves behind would go on computing.
  kill -s KILL -- -$group
  for _ in 1 2 3 4 5 6 7 8 9 10; do
    kill -s 0 -- -$group || break
    sleep 0.05
  done
  exec 9>&-
  wait
  exit $code
}

# Ends the autonomy of FOLDER, if it is the one that runs, and waits for its end.
stop() {
  group=$(cat "$1/pid") && [ "$group" = "$(cat "$cache/run.pid")" ] || exit 0
  flock -n "$cache/run.lock" true && exit 0
  kill -s TERM -- "-$group"
  flock -w "$2" "$cache/run.lock" true || kill -s KILL -- "-$group"
  flock -w 5 "$cache/run.lock" true
}

# On one line: nothing more is read from an input that stays open.
"$@"; exit
