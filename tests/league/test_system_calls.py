"""The filter of system calls, run as the kernel runs it."""

import struct

import pytest

from airrace.league.system_calls import make_filter

ALLOW, EPERM, ENOSYS, KILL = 0x7FFF0000, 0x00050001, 0x00050026, 0x80000000
MACHINES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
X86_64 = {
    "read": 0,
    "mmap": 9,
    "clone": 56,
    "execve": 59,
    "futex": 202,
    "socket": 41,
    "fork": 57,
    "vfork": 58,
    "ptrace": 101,
    "process_vm_writev": 311,
    "io_uring_setup": 425,
    "clone3": 435,
    "memfd_create": 319,
    "memfd_secret": 447,
    "shmget": 29,
    "semget": 64,
    "msgget": 68,
    "mq_open": 240,
    "userfaultfd": 323,
    "bpf": 321,
    "perf_event_open": 298,
}
THREAD = 0x00010000 | 0x100  # CLONE_THREAD, CLONE_VM


def judged(machine, number, argument=0, architecture=None):
    """What the filter returns for a system call: the three instructions that it uses, of BPF."""
    data = struct.pack("=iIQ6Q", number, architecture or MACHINES[machine], 0, argument, *[0] * 5)
    program = list(struct.iter_unpack("=HBBI", make_filter(machine)))
    accumulator, at = 0, 0
    tests = {
        0x15: lambda value: accumulator == value,
        0x35: lambda value: accumulator >= value,
        0x45: lambda value: accumulator & value != 0,
    }
    while True:
        code, true, false, value = program[at]
        at += 1
        if code == 0x06:
            return value
        if code == 0x20:
            (accumulator,) = struct.unpack_from("=I", data, value)
        else:
            at += true if tests[code](value) else false


@pytest.mark.parametrize("name", ["read", "mmap", "futex", "execve"])
def test_what_python_needs_is_allowed(name):
    assert judged("x86_64", X86_64[name]) == ALLOW


@pytest.mark.parametrize(
    "name",
    [
        *("socket", "fork", "vfork", "ptrace", "process_vm_writev", "io_uring_setup"),
        *("memfd_create", "memfd_secret", "shmget", "semget", "msgget", "mq_open"),
        *("userfaultfd", "bpf", "perf_event_open"),
    ],
)
def test_what_no_entry_needs_is_refused(name):
    assert judged("x86_64", X86_64[name]) == EPERM


@pytest.mark.parametrize("machine, clone", [("x86_64", 56), ("aarch64", 220)])
def test_threads_but_no_processes(machine, clone):
    assert judged(machine, clone, THREAD) == ALLOW
    assert judged(machine, clone, 17) == EPERM  # SIGCHLD: what fork() asks for
    assert judged(machine, 435) == ENOSYS  # the C library then takes clone()


def test_other_doors_to_the_same_calls():
    assert judged("x86_64", 0x40000000 | X86_64["socket"]) == EPERM
    i386 = 0x40000003
    assert judged("x86_64", 359, architecture=i386) == KILL


def test_a_processor_that_is_not_known():
    assert make_filter("riscv64") is None
