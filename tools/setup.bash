# Sourced by run.bash and test.bash: makes .venv in the checkout and installs a
# lock into it, unless that has been done already.

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$root/.venv
whole=$root/requirements.lock        # what developing takes; the next is a part of it
running=$root/requirements-run.lock  # what a race takes
# A copy of the lock that .venv was made from. It is written last, so a set-up
# that was interrupted leaves none and is done again.
stamp=$venv/requirements.lock

say() { echo "airrace: $*" >&2; }
die() { say "$*"; exit 2; }

# Does this interpreter run, is it one that the lock has wheels for, and can it
# make virtual environments? (Debian ships venv apart; a pyenv shim whose
# version is not active only fails.) Python 3.12 is the first that Drake
# supports; for 3.15 some of the locked packages have no wheels, and none of
# Drake's load into a free-threaded build.
usable_python() {
  "$1" -I -c '
import ensurepip, sys, sysconfig, venv
assert (3, 12) <= sys.version_info[:2] < (3, 15)
assert sys.implementation.name == "cpython"
assert not sysconfig.get_config_var("Py_GIL_DISABLED")
' >/dev/null 2>&1
}

# One candidate interpreter a line, the likeliest first.
candidate_pythons() {
  local name
  for name in python3.12 python3.13 python3.14 python3 python; do
    type -aP "$name" || true  # every one on PATH: a shim may hide a real one
  done
  printf '%s\n' "${PYENV_ROOT:-${HOME:-}/.pyenv}"/versions/*/bin/python
  # --system: never the .venv that is about to be replaced.
  if type -P uv >/dev/null; then
    uv python find --system '>=3.12,<3.15' 2>/dev/null || true
  fi
}

# Sets `python` to an interpreter to make .venv with. (To have .venv made again
# with another one, remove it.)
find_python() {
  if [ -n "${AIRRACE_PYTHON:-}" ]; then
    python=$AIRRACE_PYTHON
    usable_python "$python" || die "AIRRACE_PYTHON=$python is not a working" \
      "Python 3.12, 3.13 or 3.14 with venv: point it at one, or unset it."
    return
  fi
  while read -r python; do
    if usable_python "$python"; then return; fi
  done < <(candidate_pythons)
  if type -P uv >/dev/null; then
    say "no Python 3.12 to 3.14 found: asking uv to install one..."
    if uv python install --quiet 3.12 >&2; then
      python=$(uv python find --system 3.12 2>/dev/null) || true
      if usable_python "$python"; then return; fi
    fi
  fi
  die "no Python 3.12, 3.13 or 3.14 with venv found: install one (Debian 13," \
    "Ubuntu 24.04 or newer: 'sudo apt-get install python3-venv'; elsewhere:" \
    "uv, see https://docs.astral.sh/uv), or point AIRRACE_PYTHON at one."
}

# Does .venv hold a working installation, of whatever lock? (It does not when
# the interpreter it was made with has been removed or upgraded.)
venv_works() {
  [ -f "$stamp" ] && "$venv/bin/python" -I -c '
import importlib.util, sys
sys.exit(importlib.util.find_spec("pydrake") is None)
' >/dev/null 2>&1
}

# Was .venv made from the lock, or from one that has all that is in it?
venv_is_current() {
  local enough
  for enough in "$lock" "$whole"; do
    if [ -f "$stamp" ] && [ "$(<"$enough")" = "$(<"$stamp")" ]; then venv_works; return; fi
  done
  return 1
}

# uv takes seconds for what takes pip a minute or two. It is installed into .venv; to pip is left
# what uv can't do: reach an index that only pip knows of, say.
install_with_uv() {
  pip_install "$root/requirements-uv.lock" || return
  "$venv/bin/uv" pip install --quiet --no-progress --python "$venv/bin/python" \
    --only-binary :all: --require-hashes --requirement "$lock"
}

# Without a network, pip would try for a minute before it says so.
pip_install() {
  "$venv/bin/python" -I -m pip install --quiet --no-input --disable-pip-version-check --retries 1 \
    --only-binary :all: --require-hashes --requirement "$1"
}

install_packages_of_lock() {
  local output
  if output=$(install_with_uv 2>&1); then return; fi
  say "uv cannot install them, so that pip does, which takes a minute or two..."
  output=$(pip_install "$lock" 2>&1) || {
    printf '%s\n' "$output" >&2
    die "installing ${lock##*/} failed (see above): check the network and the disk," \
      "and that $(needed_system), and run again."
  }
}

needed_system() {
  case $OSTYPE in
    darwin*) echo "this is macOS 26 or newer on Apple silicon" ;;
    *) echo "this is 64-bit Linux with glibc 2.34 or newer (Ubuntu 22.04, Debian 12)" ;;
  esac
}

install_lock() {
  if venv_works; then
    say "${lock##*/} asks for more, or for other versions: updating .venv..."
    rm -f "$stamp"
  else
    rm -f "$stamp"
    find_python
    say "setting up .venv with $python (the first time takes a minute or less)..."
    "$python" -I -m venv --clear "$venv" >&2 || die "making $venv failed" \
      "(see above): check that the disk is writable and not full, and run again."
  fi

  install_packages_of_lock

  # Put the checkout on the interpreter's path: `import airrace` works from any
  # directory, edits take effect at once, and nothing has to be built. The line
  # is relative to site-packages so that a moved or copied checkout uses itself.
  echo ../../../.. >"$(echo "$venv"/lib/python3*/site-packages)/airrace.pth"

  cp "$lock" "$stamp.new" && mv "$stamp.new" "$stamp"
}

# A copy of airrace in .venv (pip install . without -e) hides this checkout: edits would do
# nothing, and nobody would know why.
refuse_copy() {
  local copies=("$venv"/lib/python3*/site-packages/airrace)
  [ ! -e "${copies[0]}" ] || die "a copy of airrace in .venv hides this checkout: remove it with" \
    "'.venv/bin/python -m pip uninstall airrace', and install extras with -e:" \
    "'.venv/bin/python -m pip install -e .[notebooks]'."
}

# Drake has no wheels for Windows.
refuse_windows() {
  case $OSTYPE in
    msys* | cygwin*) die "airrace does not run on Windows itself: run it in WSL2, see" \
      "https://learn.microsoft.com/windows/wsl/install." ;;
  esac
}

# Makes .venv ready for use.
# Args: the lock to be installed, unless one is that has more.
set_up() {
  lock=$1
  refuse_windows
  refuse_copy
  if venv_is_current; then return; fi
  [ -w "$root" ] || die "$root has to be set up and you may not write there:" \
    "copy it to a directory of yours."
  {
    # One at a time, where flock exists; the second finds the work done.
    if type -P flock >/dev/null && ! flock -n 9; then
      say "waiting for another set-up to finish..."
      flock 9
    fi
    if ! venv_is_current; then
      install_lock
      say "ready."
    fi
  } 9<>"$whole"
}

# missing_packages USE...: prints, on one line, the Debian packages that this
# system lacks for each use. The wheels bring everything else: a bare Debian 12
# or 13 lacks only these.
#   drake      importing pydrake
#   rendering  RenderEngineVtk without a screen; Mesa draws where there is no GPU
#   sandbox    bubblewrap, the wall around the entries of a league
missing_packages() {
  "$venv/bin/python" -I -c '
import ctypes, shutil, sys

def drake():
    ctypes.CDLL("libglib-2.0.so.0")

def rendering():
    # It is not enough that EGL loads: where it finds no driver to initialize,
    # VTK crashes. 0x31DD is EGL_PLATFORM_SURFACELESS_MESA.
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetPlatformDisplay.restype = ctypes.c_void_p
    display = ctypes.c_void_p(egl.eglGetPlatformDisplay(0x31DD, None, None))
    if not egl.eglInitialize(display, None, None):
        raise OSError

def sandbox():
    if shutil.which("bwrap") is None:
        raise OSError

uses = {
    "drake": (drake, "libglib2.0-0"),
    "rendering": (rendering, "libegl1 libgl1-mesa-dri"),
    "sandbox": (sandbox, "bubblewrap"),
}
missing = []
for check, packages in map(uses.get, sys.argv[1:]):
    try:
        check()
    except (OSError, AttributeError):
        missing.append(packages)
if sys.platform == "linux":  # elsewhere, the wheels bring these too
    print(*missing)
' "$@" 2>/dev/null || true
}

install_hint() {
  echo "install it with 'sudo apt-get install $1' (Debian, Ubuntu) or the like"
}

# For root on Debian and Ubuntu.
# shellcheck disable=SC2086  # one word a package
install_packages() {
  export DEBIAN_FRONTEND=noninteractive
  apt-get update --quiet || return
  apt-get install --quiet --yes --no-install-recommends $1
}
