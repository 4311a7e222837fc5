# Read by `sh -s` on a companion computer: prints its cache folder, its machine,
# and a Python that can run airrace, if there is one. The same rules as in
# tools/setup.bash: CPython 3.12 to 3.14, with venv and pip, not free-threaded.

cache=${XDG_CACHE_HOME:-$HOME/.cache}/airrace
echo "airrace-cache: $cache"
echo "airrace-machine: $(uname -s) $(uname -m)"

# A command that ssh runs sees less of PATH than a login does: uv and the links
# that it makes are in here.
PATH=$PATH:$HOME/.local/bin:$HOME/.cargo/bin

try() {
  "$1" -I -c '
import ensurepip, sys, sysconfig, venv
assert (3, 12) <= sys.version_info[:2] < (3, 15)
assert sys.implementation.name == "cpython"
assert not sysconfig.get_config_var("Py_GIL_DISABLED")
print("airrace-python:", sys.executable)
' 2>/dev/null </dev/null && exit 0
}

for name in python3.12 python3.13 python3.14 python3; do
  try "$name"
done
for python in "${PYENV_ROOT:-$HOME/.pyenv}"/versions/*/bin/python; do
  try "$python"
done
if command -v uv >/dev/null; then
  echo "airrace-uv: $(command -v uv)"
  try "$(uv python find --system '>=3.12,<3.15' 2>/dev/null </dev/null)"
fi
exit 0
