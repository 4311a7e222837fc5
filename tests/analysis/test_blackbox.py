"""Logs of a flight controller are read back to what was written, by an encoder of our own."""

import numpy as np
import pytest

from airrace.analysis.blackbox import read_blackbox

NAMES = (
    "loopIteration time axisP[0] axisI[0] axisI[1] axisI[2] s[0] s[1] s[2] s[3] "
    "v[0] v[1] v[2] n baro one motor[0] motor[1]"
).split()
I_PREDICTORS = [0, 0] + 14 * [0] + [11, 5]
P_PREDICTORS = [6, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 1, 8, 3, 3]
I_ENCODINGS = [1, 1] + 14 * [0] + [1, 0]
P_ENCODINGS = [9, 0, 0, 7, 7, 7, 8, 8, 8, 8, 10, 10, 10, 3, 6, 0, 0, 0]
HEAD = f"""H Product:Blackbox flight data recorder by Nicholas Sherlock
H Data version:2
H Field I name:{",".join(NAMES)}
H Field I predictor:{",".join(map(str, I_PREDICTORS))}
H Field I encoding:{",".join(map(str, I_ENCODINGS))}
H Field P predictor:{",".join(map(str, P_PREDICTORS))}
H Field P encoding:{",".join(map(str, P_ENCODINGS))}
H Field S name:flags,phase
H Field S encoding:1,1
H Field S predictor:0,0
H motorOutput:1000,2000
"""


def unsigned(value):
    digits = []
    while value > 127:
        digits.append(value & 127 | 128)
        value >>= 7
    return bytes([*digits, value])


def signed(value):
    return unsigned(2 * value if value >= 0 else -2 * value - 1)


def fits(values, *sizes):
    return all(-(1 << size - 1) <= v < 1 << size - 1 for v, size in zip(values, sizes))


def packed(tag, values, sizes, length):
    bits = tag
    for value, size in zip(values, sizes):
        bits = bits << size | value & (1 << size) - 1
    return bits.to_bytes(length, "big")


def bytes_each(values):
    tag, data = 0, b""
    for i, value in enumerate(values):
        size = next(n for n in (1, 2, 3, 4) if fits([value], 8 * n))
        tag |= (size - 1) << 2 * i
        data += value.to_bytes(size, "little", signed=True)
    return bytes([0xC0 | tag]) + data


def tag2_3(values):
    if fits(values, 2, 2, 2):
        return packed(0, values, (2, 2, 2), 1)
    if fits(values, 4, 4, 4):
        return packed(0b0100, values, (4, 4, 4), 2)
    if fits(values, 6, 6, 6):
        a, b, c = (v & 63 for v in values)
        return bytes([0x80 | a, b, c])
    return bytes_each(values)


def tag2_3_variable(values):
    if fits(values, 2, 2, 2):
        return packed(0, values, (2, 2, 2), 1)
    if fits(values, 5, 5, 4):
        return packed(1, values, (5, 5, 4), 2)
    if fits(values, 8, 7, 7):
        return packed(2, values, (8, 7, 7), 3)
    return bytes_each(values)


def tag8_4(values):
    tag, digits = 0, ""
    for i, value in enumerate(values):
        kind = 0 if value == 0 else next(k for k in (1, 2, 3) if fits([value], 2 << k))
        tag |= kind << 2 * i
        width = (0, 1, 2, 4)[kind]
        digits += f"{value & (1 << 4 * width) - 1:0{width}x}" if width else ""
    return bytes([tag]) + bytes.fromhex(digits + "0" * (len(digits) % 2))


def frame(kind, row, before):
    """The bytes of a frame, and of its fields in the order of their encodings."""
    predictors, encodings = (
        (I_PREDICTORS, I_ENCODINGS) if kind == "I" else (P_PREDICTORS, P_ENCODINGS)
    )
    off = []
    for i, predictor in enumerate(predictors):
        expected = {
            0: lambda i: 0,
            1: lambda i: before[0][i],
            2: lambda i: 2 * before[0][i] - before[1][i],
            3: lambda i: int((before[0][i] + before[1][i]) / 2),
            5: lambda i: row[NAMES.index("motor[0]")],
            6: lambda i: before[0][i] + 1,
            8: lambda i: 1500,
            11: lambda i: 1000,
        }[predictor](i)
        off.append(row[i] - expected)
    data, i = kind.encode(), 0
    while i < len(off):
        encoding = encodings[i]
        size = {7: 3, 8: 4, 10: 3}.get(encoding, 1)
        group = off[i : i + size]
        data += {
            0: lambda v: signed(v[0]),
            1: lambda v: unsigned(v[0]),
            3: lambda v: unsigned(-v[0] & 0x3FFF),
            6: lambda v: signed(v[0]),  # alone, it has no tag
            7: tag2_3,
            8: tag8_4,
            9: lambda v: b"",
            10: tag2_3_variable,
        }[encoding](group)
        i += size
    return data


def make_log(count=400):
    """The bytes of a log, its rows, and where each frame ends."""
    random = np.random.default_rng(0)
    log, rows, before, ends = HEAD.encode(), [], [], []
    state = random.integers(-50, 50, len(NAMES)).tolist()
    for k in range(count):
        scale = int(random.choice((1, 3, 20, 100, 3000)))
        row = [v + int(random.integers(-scale, scale + 1)) for v in state]
        row[0], row[1] = k, 1_000_000 + 4000 * k + int(random.integers(-5, 6))
        row[13] = int(random.integers(-8000, 8000))
        row[16:] = random.integers(1000, 2000, 2).tolist()
        kind = "I" if k % 32 == 0 else "P"
        log += frame(kind, row, before)
        if k % 50 == 0:
            log += b"S" + unsigned(k) + unsigned(1) + b"E\x1e" + unsigned(k) + unsigned(0)
        before = [row, row if kind == "I" else before[0]]
        rows.append(row)
        ends.append(len(log))
        state = [max(-20000, min(20000, v)) for v in row]
    return log, np.array(rows), ends


def test_what_was_written_is_read(tmp_path):
    log, rows, _ = make_log()
    (tmp_path / "log").write_bytes(log + b"E\xffEnd of log\x00")
    frames = read_blackbox(tmp_path / "log")
    assert list(frames.columns) == NAMES
    np.testing.assert_allclose(frames["time"], rows[:, 1] / 1e6)
    np.testing.assert_array_equal(frames.drop(columns="time"), np.delete(rows, 1, axis=1))


def test_a_log_that_ends_early_is_read_so_far(tmp_path):
    log, rows, ends = make_log(100)
    for end in (ends[60], ends[60] + 3):
        (tmp_path / "log").write_bytes(log[:end])
        assert len(read_blackbox(tmp_path / "log")) == 61
    (tmp_path / "log").write_bytes(log[: ends[60]] + b"\xff\xff?" + log[ends[60] :])
    assert len(read_blackbox(tmp_path / "log")) == 61


@pytest.mark.parametrize("damage", [b"", b"no log", HEAD.encode().replace(b"H Field P", b"H Feld")])
def test_what_is_no_log_is_said(tmp_path, damage):
    (tmp_path / "log").write_bytes(damage)
    with pytest.raises(ValueError):
        read_blackbox(tmp_path / "log")


def test_damage_is_a_value_error_at_most(tmp_path):
    log, _, _ = make_log(60)
    random = np.random.default_rng(1)
    for _ in range(300):
        damaged = bytearray(log)
        for at in random.integers(0, len(log), random.integers(1, 6)):
            damaged[at] = random.integers(256)
        (tmp_path / "log").write_bytes(damaged[: random.integers(1, len(log) + 1)])
        try:
            frames = read_blackbox(tmp_path / "log")
        except ValueError:
            continue
        assert len(frames) <= len(log)
