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

_SOCK_FILTER = struct.Struct("=HBBI")  # code, jumps if true and if false, value

_CLONE = {"x86_64": 56, "aarch64": 220}
_CLONE3 = 435  # its flags are in memory, where a filter cannot look; the C library does without
# Numbers by name and processor; one without a number has no such call.
_REFUSED = {
    "socket": {"x86_64": 41, "aarch64": 198},
    "fork": {"x86_64": 57},
    "vfork": {"x86_64": 58},
    # Memory that no limit of the process counts, or that outlives it.
    "shmget": {"x86_64": 29, "aarch64": 194},
    "semget": {"x86_64": 64, "aarch64": 190},
    "msgget": {"x86_64": 68, "aarch64": 186},
    "mq_open": {"x86_64": 240, "aarch64": 180},
    "memfd_create": {"x86_64": 319, "aarch64": 279},
    "memfd_secret": {"x86_64": 447, "aarch64": 447},
    "ptrace": {"x86_64": 101, "aarch64": 117},
    "mount": {"x86_64": 165, "aarch64": 40},
    "add_key": {"x86_64": 248, "aarch64": 217},
    "request_key": {"x86_64": 249, "aarch64": 218},
    "keyctl": {"x86_64": 250, "aarch64": 219},
    "unshare": {"x86_64": 272, "aarch64": 97},
    "perf_event_open": {"x86_64": 298, "aarch64": 241},
    "setns": {"x86_64": 308, "aarch64": 268},
    "process_vm_readv": {"x86_64": 310, "aarch64": 270},
    "process_vm_writev": {"x86_64": 311, "aarch64": 271},
    "bpf": {"x86_64": 321, "aarch64": 280},
    "userfaultfd": {"x86_64": 323, "aarch64": 282},
    "io_uring_setup": {"x86_64": 425, "aarch64": 425},
}


def make_filter(machine: str | None = None) -> bytes | None:
    """Returns the filter for a processor, or None if its calls are not known here.

    Args: machine: as platform.machine() calls it; by default, this computer's.
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
    for numbers in _REFUSED.values():
        if machine in numbers:
            program += [_jump(_EQUAL, numbers[machine], over=0, otherwise=1), refused]
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
    return _SOCK_FILTER.pack(_LOAD, 0, 0, offset)


def _jump(test: int, value: int, over: int, otherwise: int) -> bytes:
    """Skips `over` instructions if the test holds, else `otherwise`."""
    return _SOCK_FILTER.pack(test, over, otherwise, value)


def _return(value: int) -> bytes:
    return _SOCK_FILTER.pack(_RETURN, 0, 0, value)
