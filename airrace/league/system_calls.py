"""System calls that an entry has no use for, refused by the kernel: a filter for seccomp(2).

The filter is a program of the kernel's classic BPF, which bubblewrap loads before it starts the
entry. What it refuses fails with EPERM, as if the user had no right to it. Threads are allowed,
processes are not.
"""

import platform
import struct

# From linux/audit.h, linux/seccomp.h, linux/bpf_common.h and linux/sched.h.
_ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
_KILL, _ALLOW, _ERRNO = 0x80000000, 0x7FFF0000, 0x00050000
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_NUMBER, _ARCHITECTURE, _FIRST_ARGUMENT = 0, 4, 16  # offsets in struct seccomp_data
_EPERM, _ENOSYS = 1, 38
_CLONE_THREAD = 0x00010000
_X32 = 0x40000000  # numbers of another interface of x86-64's to the same calls

_CLONE = {"x86_64": 56, "aarch64": 220}
_CLONE3 = 435  # its flags are in memory, where a filter cannot look; the C library does without
_REFUSED = {
    "x86_64": {
        "socket": 41,
        "fork": 57,
        "vfork": 58,
        "ptrace": 101,
        "mount": 165,
        "add_key": 248,
        "request_key": 249,
        "keyctl": 250,
        "unshare": 272,
        "perf_event_open": 298,
        "setns": 308,
        "process_vm_readv": 310,
        "process_vm_writev": 311,
        "bpf": 321,
        "userfaultfd": 323,
        "io_uring_setup": 425,
    },
    "aarch64": {
        "mount": 40,
        "unshare": 97,
        "ptrace": 117,
        "socket": 198,
        "add_key": 217,
        "request_key": 218,
        "keyctl": 219,
        "perf_event_open": 241,
        "setns": 268,
        "process_vm_readv": 270,
        "process_vm_writev": 271,
        "bpf": 280,
        "userfaultfd": 282,
        "io_uring_setup": 425,
    },
}


def make_filter(machine: str | None = None) -> bytes | None:
    """Returns the filter for a processor, or None if its calls are not known here.

    Args:
        machine: as platform.machine() calls it; by default, this computer's.
    """
    machine = machine or platform.machine()
    if machine not in _ARCHITECTURES:
        return None
    refused = _return(_ERRNO | _EPERM)
    program = [
        _load(_ARCHITECTURE),
        _jump(_EQUAL, _ARCHITECTURES[machine], over=1, otherwise=0),
        _return(_KILL),
        _load(_NUMBER),
        _jump(_AT_LEAST, _X32, over=0, otherwise=1),
        refused,
    ]
    for number in _REFUSED[machine].values():
        program += [_jump(_EQUAL, number, over=0, otherwise=1), refused]
    program += [
        _jump(_EQUAL, _CLONE3, over=0, otherwise=1),
        _return(_ERRNO | _ENOSYS),
        _jump(_EQUAL, _CLONE[machine], over=0, otherwise=3),
        _load(_FIRST_ARGUMENT),
        _jump(_ANY_BIT, _CLONE_THREAD, over=1, otherwise=0),
        refused,
        _return(_ALLOW),
    ]
    return b"".join(program)


def _load(offset: int) -> bytes:
    return _instruction(_LOAD, 0, 0, offset)


def _jump(test: int, value: int, over: int, otherwise: int) -> bytes:
    """Skips `over` instructions if the test holds, else `otherwise`."""
    return _instruction(test, over, otherwise, value)


def _return(value: int) -> bytes:
    return _instruction(_RETURN, 0, 0, value)


def _instruction(code: int, true: int, false: int, value: int) -> bytes:
    """Returns a struct sock_filter."""
    return struct.pack("=HBBI", code, true, false, value)
