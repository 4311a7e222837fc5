"""Files and messages of others: whatever is wrong with them is a sentence at most.

`python -m benchmarks.robustness` tries more of them.
"""

from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.worlds.untrusted_files import FILES
from tests.worlds.untrusted_kind import try_input
from tests.worlds.untrusted_messages import MESSAGES

KINDS = (*FILES, *MESSAGES)


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
def test_what_is_broken_is_a_sentence_at_most(sound, kind, seed):
    path, whole = sound(kind)
    try_input(kind, path, kind.mutate(Random(seed), whole))


def test_what_is_sound_is_taken(sound):
    for kind in KINDS:
        if not kind.slow:
            path, whole = sound(kind)
            path.write_bytes(whole)
            kind.read(path)
