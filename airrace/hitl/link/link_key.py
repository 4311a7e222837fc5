"""Who has the key of a link may speak on it: a keyed digest below every datagram.

Each datagram ends with 32 bytes: who sent it, drawn at the sender's start (8), how many it has sent
(8), and the keyed BLAKE2b digest of all before (16).
"""

import collections
import hashlib
import hmac
import secrets
import struct
from pathlib import Path

from airrace.common.errors import UserError, words
from airrace.common.files import read_regular
from airrace.hitl.link.packets import REPLAYED, Dropped

UNSIGNED = "not signed with the link's key"
TRAILER = 32  # bytes below a datagram
_MARK, _DIGEST = struct.Struct(">QQ"), 16
_LEAST, _MOST = 32, 1 << 16  # bytes of a key's file
_WINDOW = 1024  # datagrams, by which one may be late
_SENDERS = 64  # whose newest number is remembered
_MAKE = "(umask 077; head -c 32 /dev/urandom > FILE) makes one"


def read_key(path: Path) -> bytes:
    """Returns the key in a file, for a Seal.

    Raises UserError if there is none, it is too short, or others may read it.
    """
    try:
        key, mode = read_regular(path, _MOST + 1), path.stat().st_mode
    except (OSError, ValueError) as e:
        raise UserError(f"--link_key {path} cannot be read ({words(e)}); {_MAKE}.") from None
    if mode & 0o077:
        raise UserError(f"--link_key {path} is open to others: chmod 600 {path}, on both sides.")
    if not _LEAST <= len(key) <= _MOST:
        raise UserError(f"--link_key {path} is no file of {_LEAST} to {_MOST} bytes; {_MAKE}.")
    return key


def key_of(path: Path | None) -> bytes | None:
    """Returns the key in the file that --link_key names, None if it names none; see read_key()."""
    return None if path is None else read_key(path)


class Seal:
    """Signs the datagrams of a sender, and checks those of others with the same key."""

    def __init__(self, key: bytes):
        """Args: key: from read_key()."""
        self._key = hashlib.blake2b(key, person=b"airrace link").digest()
        self._own, self._sent = secrets.randbits(64), 0
        # By sender, the one that was heard last at the end: the highest number that came, and which
        # of those before it came, as bits.
        self._heard: collections.OrderedDict[int, tuple[int, int]] = collections.OrderedDict()

    def sealed(self, datagram: bytes) -> bytes:
        """Returns a datagram with its trailer."""
        self._sent += 1
        marked = datagram + _MARK.pack(self._own, self._sent)
        return marked + self._digest(marked)

    def opened(self, datagram: memoryview) -> tuple[memoryview, int]:
        """Returns a datagram without its trailer, and who sent it.

        Raises Dropped if it was not sealed with this key, or came before.
        """
        end = len(datagram) - TRAILER
        if end < 0 or not hmac.compare_digest(
            self._digest(datagram[:-_DIGEST]), datagram[-_DIGEST:]
        ):
            raise Dropped(UNSIGNED)
        sender, number = _MARK.unpack_from(datagram, end)
        self._note(sender, number)
        return datagram[:end], sender

    def _digest(self, marked):
        return hashlib.blake2b(marked, digest_size=_DIGEST, key=self._key).digest()

    def _note(self, sender, number):
        """Notes that a datagram came; raises Dropped if it did before, or is too late to tell."""
        highest, came = self._heard.get(sender, (0, 0))
        ahead = number - highest
        if ahead > 0:
            came = (came << ahead | 1) & ((1 << _WINDOW) - 1) if ahead < _WINDOW else 1
            highest = number
        elif -ahead >= _WINDOW or came >> -ahead & 1:
            raise Dropped(REPLAYED)
        else:
            came |= 1 << -ahead
        self._heard[sender] = highest, came
        self._heard.move_to_end(sender)
        if len(self._heard) > _SENDERS:
            self._heard.popitem(last=False)
