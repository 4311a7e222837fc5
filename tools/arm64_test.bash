#!/usr/bin/env bash
# Races with the autonomy on an emulated 64-bit Arm computer; --help tells more.
set -euo pipefail
source "$(dirname "$(readlink -f "$0")")/setup.bash"

usage() {
  cat <<'END'
usage: tools/arm64_test.bash [--folder DIR]

Flies the autonomy on an emulated 64-bit Arm computer, and compares the race
with the same one on this computer. It takes half an hour to an hour, and less
when this very airrace has been compiled there before. These are the steps:

  1. a root file system of Debian 13 for Arm, by debootstrap, whose programs run
     here by qemu-user;
  2. an environment of requirements-run.lock in it, with wheels for Arm;
  3. a race of the hexagon in one process on this computer;
  4. the same race in lockstep over loopback, with the autonomy in the Arm root;
  5. the start of a race whose autonomy is started in the Arm root over ssh, by
     tests/hitl/companion/test_arm64.py;
  6. a table of the two races. The exit code is 0 if they agree.

  --folder DIR  where the root is kept for the next time, 1.4 GB; it and all
                folders above must be writable by root alone
                (default: ~/.cache/airrace/arm64)

It needs root (for mounts and network namespaces), the network, and debootstrap,
qemu-user-static, iproute2 and openssh-server. What it mounts is seen by itself
only, and goes with it. All waits are 20 times as long as usual; with
AIRRACE_PATIENCE=40 they are 40 times as long.
END
}

folder=${XDG_CACHE_HOME:-${HOME:-/root}/.cache}/airrace/arm64
while [ $# -gt 0 ]; do
  case $1 in
    -h | --help) usage; exit ;;
    --folder) folder=${2:-}; shift 2 2>/dev/null || die "--folder needs a folder." ;;
    --folder=*) folder=${1#*=}; shift ;;
    *) die "there is no option $1: see --help." ;;
  esac
done
[ -n "$folder" ] || die "--folder needs a folder."

check_needs() {
  [ "$(uname -m)" = x86_64 ] || die "this computer is no x86-64, with which Arm is compared: run" \
    "./test.bash on it."
  [ "$(id -u)" = 0 ] || die "only root can make mounts and network namespaces: run it with sudo."
  local program missing=()
  for program in debootstrap:debootstrap qemu-aarch64-static:qemu-user-static ip:iproute2 \
    sshd:openssh-server; do
    type -P "${program%:*}" >/dev/null || missing+=("${program#*:}")
  done
  [ ${#missing[@]} = 0 ] ||
    die "something that it needs is missing: $(install_hint "${missing[*]}")."
}

# Sshd lets nobody into a root that others than root could have put there.
check_folder() {
  local place=$folder owner mode
  while true; do
    read -r owner mode < <(stat -c '%u %a' "$place")
    [ "$owner" = 0 ] && (((8#$mode & 8#022) == 0)) || die "others than root may write to $place," \
      "so that sshd lets nobody into a root below it: name another --folder," \
      "such as /var/cache/airrace/arm64."
    [ "$place" != / ] || return 0
    place=$(dirname "$place")
  done
}

# Its mounts are seen by this process and its children only.
[ -n "${AIRRACE_ARM64_UNSHARED:-}" ] || {
  check_needs
  mkdir -p "$folder"
  AIRRACE_ARM64_UNSHARED=1 exec unshare --mount "$0" --folder "$folder"
}

folder=$(cd "$folder" && pwd)
check_folder
board=$folder/root
log=$folder/log
races=$folder/races
network=airrace-arm64-$$
formats=/proc/sys/fs/binfmt_misc
format=$formats/$network
# The processor that is emulated. Qemu's default one, "max", has instructions with
# which numpy multiplies small matrices wrongly in it. The variable must be set
# wherever a program of the root is started; over ssh, the server sets it.
export QEMU_CPU=cortex-a76
export AIRRACE_PATIENCE=${AIRRACE_PATIENCE:-20}
# The first words of a command in the root.
on_board=(chroot "$board" env -i HOME=/root PATH=/usr/bin:/bin "QEMU_CPU=$QEMU_CPU"
  "AIRRACE_PATIENCE=$AIRRACE_PATIENCE")

clean_up() {
  # shellcheck disable=SC2046  # one word a process
  kill $(jobs -p) 2>/dev/null || true
  ip netns delete "$network" 2>/dev/null || true
  [ ! -e "$format" ] || echo -1 >"$format"
}

# Runs a quiet command; what it says is in the log, and is shown if it fails.
quietly() {
  "$@" >"$log" 2>&1 || {
    tail -n 20 "$log" >&2
    die "$1 failed (see above, and $log)."
  }
}

# From now on the kernel starts programs for 64-bit Arm by qemu, which it opens
# now (F): inside the root there is none.
register_qemu() {
  [ -e $formats/register ] || mount -t binfmt_misc binfmt_misc $formats
  local magic='\x7fELF\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00'
  local mask='\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff'
  printf ':%s:M::%s:%s:%s:OCF' "${format##*/}" "$magic" "$mask" "$(type -P qemu-aarch64-static)" \
    >$formats/register
}

make_root() {
  if [ ! -e "$folder/complete" ]; then
    say "making a root of Debian 13 for Arm in $board: a quarter of an hour..."
    rm -rf --one-file-system "$board"
    quietly debootstrap --arch=arm64 --variant=minbase \
      --include=ca-certificates,libglib2.0-0t64,python3-venv trixie "$board"
    touch "$folder/complete"
  fi
  mount -t proc proc "$board/proc"
  mount --rbind /dev "$board/dev"
}

# Sets `environment` and `package`: where in the root a set-up over ssh looks for them.
find_places() {
  read -r environment package < <(cd "$root" && "$venv/bin/python" -c '
from airrace.common.files import digest
from airrace.hitl.companion.set_up import LOCK, checkout_path, source_digest
root = checkout_path()
print(digest(root / LOCK), source_digest(root))')
  environment=/root/.cache/airrace/environments/$environment
  package=/root/.cache/airrace/packages/$package
}

# As board.sh does it, but pip runs on this computer: emulated, it would take an hour.
# It judges the lock's markers by this computer, and brings MOSEK along.
make_environment() {
  [ ! -e "$board$environment/complete" ] || return 0
  rm -rf "$(dirname "$board$environment")"
  say "installing requirements-run.lock for Arm..."
  "${on_board[@]}" python3 -I -m venv --clear --without-pip "$environment"
  local packages version glibc platforms=()
  packages=$(echo "$board$environment"/lib/python3*/site-packages)
  version=$(basename "$(dirname "$packages")")
  for glibc in 2_34 2_28 2_27 2_17; do
    platforms+=(--platform "manylinux_${glibc}_aarch64")
  done
  quietly "$venv/bin/python" -I -m pip install --no-input --disable-pip-version-check \
    --no-deps --only-binary :all: --require-hashes --requirement "$root/requirements-run.lock" \
    --python-version "${version#python}" "${platforms[@]}" --platform manylinux2014_aarch64 \
    --no-compile --target "$packages"
  compile_bytecode "$version" "$packages"
  touch "$board$environment/complete"
}

# Byte code is the same for all processors. Where this computer has no Python of the
# root's version, the first race makes it, emulated, which takes minutes.
compile_bytecode() {
  local python
  while read -r python; do
    if usable_python "$python" && [ "$("$python" -I -c '
import sys
print("python%d.%d" % sys.version_info[:2])')" = "$1" ]; then
      # Some packages have files that only their own tests compile.
      "$python" -I -m compileall -q -s "$board" "$2" >"$log" 2>&1 || true
      return
    fi
  done < <(candidate_pythons)
}

make_package() {
  rm -rf "$(dirname "$board$package")"
  mkdir -p "$board$package"
  tar -C "$root" --exclude=__pycache__ -c airrace models | tar -C "$board$package" -x -o
  touch "$board$package/complete"
}

# Minimum snap: time-optimal transitions differ by more than rounding, see docs/hitl.md.
scenario='{track: hexagon, laps: 1, trajectory: "3"}'

# fly NAME OPTION...: a race of the hexagon, simulated on this computer.
fly() {
  (cd "$root" && ip netns exec "$network" "$venv/bin/python" -m airrace race --no-meshcat \
    --no-report --record none --scenario_text "$scenario" --output "$races/$1" "${@:2}")
}

fly_on_board() {
  rm -rf "$board/root/autonomy"
  fly arm64 -s HITL --lockstep --companion none &
  ip netns exec "$network" "${on_board[@]}" PYTHONPATH="$package" PYTHONUNBUFFERED=1 \
    "$environment/bin/python" -m airrace hitl autonomy --scenario_text "$scenario" \
    --output /root/autonomy &
  # The one that ends first must not leave the other waiting.
  wait -n && wait -n
}

# One at a time, in this folder.
exec 9>"$folder/lock"
flock -n 9 || die "another run uses $folder: wait for its end, or name another --folder."
trap clean_up EXIT
trap 'exit 1' INT TERM
set_up "$whole"
register_qemu
make_root
find_places
make_environment
[ -e "$board$package/complete" ] || make_package
ip netns add "$network"
ip -n "$network" link set lo up
ip -n "$network" route add 224.0.0.0/4 dev lo

rm -rf "$races"
mkdir "$races"
say "racing on this computer..."
fly x86-64
say "racing with the autonomy on Arm: minutes, and the first time many more, to compile..."
fly_on_board || die "the race with the autonomy on Arm failed (see above)."
say "starting a race over ssh..."
AIRRACE_ARM64_ROOT=$board "$root/test.bash" -n 0 -rs tests/hitl/companion/test_arm64.py
cd "$root" && "$venv/bin/python" -m tools.arm64_table "$races/x86-64" "$races/arm64"
