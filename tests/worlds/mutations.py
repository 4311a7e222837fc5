"""Makes broken files out of sound ones, the same for the same random numbers."""

import copy
import json
from random import Random

import yaml

# What somebody who means harm, or an editor, may have put in the place of a value.
_VALUES = (
    *(None, True, -1, 0, 1, 2**31, 2**64, 10**400, 0.5, -0.0, 1e-300, 1e6, 1e9, 1e308),
    *(float("nan"), float("inf"), float("-inf")),
    *("", "text", "0", "nan", "../../etc/passwd", "\x1b]52;c;x\x07", "\u202e", "\0", "<b>", "%s"),
    *("\ud800", "x" * 100_000, [], {}, [[]], {"": None}, [1, 2, 3], [None] * 1000),
)


def mutated_bytes(rng: Random, data: bytes) -> bytes:
    """Returns bytes with one to four changes, each somewhere."""
    for _ in range(rng.randint(1, 4)):
        at, size = rng.randrange(len(data) + 1), rng.choice((1, 1, 1, 4, 30, 3000))
        match rng.randrange(7):
            case 0:
                flipped = bytes(byte ^ 1 << rng.randrange(8) for byte in data[at : at + 1])
                data = data[:at] + flipped + data[at + 1 :]
            case 1:
                data = data[:at]
            case 2:
                data = data[:at] + data[at + size :]
            case 3:
                data = data[:at] + rng.randbytes(size) + data[at:]
            case 4:
                data = data[:at] + rng.randbytes(len(data[at : at + size])) + data[at + size :]
            case 5:
                data = data[:at] + data[at : at + size] * rng.randint(2, 9) + data[at + size :]
            case _:
                part = rng.choice((b"[", b"{", b"\xff", b"\0", b'"', b"-", b"9", b"&a [*a,", b"\n"))
                data = data[:at] + part * rng.choice((1, 5, 2000)) + data[at:]
    return data


def mutated_json(rng: Random, data: bytes) -> bytes:
    """Returns a text of JSON with other values, or other bytes."""
    if rng.random() < 0.25:
        return mutated_bytes(rng, data)
    # As Python writes them: NaN, and halves of characters as escapes.
    return json.dumps(_mutated(rng, json.loads(data))).encode()


def mutated_yaml(rng: Random, data: bytes) -> bytes:
    """Returns a text of YAML with other values, or other bytes."""
    if rng.random() < 0.25:
        return mutated_bytes(rng, data)
    document = _mutated(rng, yaml.safe_load(data))
    return yaml.safe_dump(document).encode("utf-8", errors="surrogatepass")


def _mutated(rng: Random, document: object) -> object:
    """Returns plain data with one or two values that are others, are gone, or come twice."""
    document = copy.deepcopy(document)
    for _ in range(rng.randint(1, 2)):
        holders = [holder for holder in _holders(document) if len(holder)]
        if not holders:
            return rng.choice(_VALUES)
        holder = rng.choice(holders)
        key = rng.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
        match rng.randrange(4):
            case 0:
                del holder[key]
            case 1 if isinstance(holder, list):
                holder.append(copy.deepcopy(holder[key]))
            case 2 if type(holder[key]) in (int, float) and abs(holder[key]) < 1e290:
                holder[key] *= rng.choice((-1, 1 + 1e-12, 1e3, 1e-3, 1e12))
            case _:
                holder[key] = copy.deepcopy(rng.choice(_VALUES))
    return document


def _holders(document):
    """Yields all lists and dicts of plain data."""
    if isinstance(document, (dict, list)):
        yield document
        for each in document.values() if isinstance(document, dict) else document:
            yield from _holders(each)
