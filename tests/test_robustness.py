"""Files that others give you: whatever is wrong with them is a sentence; see benchmarks/robustness.py."""

from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from airrace.common.errors import UserError
from benchmarks import robustness
from benchmarks.untrusted_files import KINDS, Kind, WrongResult, try_input


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Kinds to a sound file and its bytes."""
    made = {}

    def make(kind):
        if kind.name not in made:
            path = kind.make(tmp_path_factory.mktemp("sound"))
            made[kind.name] = path, path.read_bytes()
        return made[kind.name]

    return make


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, id=kind.name, marks=[pytest.mark.repeats] if kind.slow else [])
        for kind in KINDS
    ],
)
@settings(max_examples=8, deadline=10_000, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32 - 1))
def test_a_broken_file_is_a_sentence_at_most(sound, kind, seed):
    path, whole = sound(kind)
    try_input(kind, path, kind.mutate(Random(seed), whole))


def test_a_sound_file_is_read(sound):
    for kind in KINDS:
        if not kind.slow:
            path, whole = sound(kind)
            path.write_bytes(whole)
            kind.read(path)


def test_each_harm_is_counted(monkeypatch):
    def read(path):
        match path.read_bytes():
            case b"crash":
                raise KeyError("x")
            case b"hang":
                while True:
                    pass
            case b"wrong":
                raise WrongResult("another flight")
            case b"sentence":
                raise UserError("It is broken.")

    inputs = [b"crash", b"hang", b"wrong", b"sentence", b"fine", b"crash"]

    def make(folder):
        (folder / "file").write_bytes(b"fine")
        return folder / "file"

    def mutate(rng, data):
        return inputs.pop(0)

    monkeypatch.setattr(robustness, "KINDS", [Kind("file", make, mutate, read)])
    monkeypatch.setattr(robustness, "_LONGEST", 0.05)
    row = robustness.try_kind("file", 6)
    assert (row["crashes"], row["hangs"], row["wrong"]) == (2, 1, 1)
    (table, found), kept = robustness.show([row])
    assert not kept and found.startswith("file: input 0: KeyError: 'x' (test_robustness.py:")
    row = row | {"first": None}
    assert robustness.show([row])[1]
