"""Text from outside, as it is shown."""

import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from airrace.common.words import printable
from tests.worlds.cases import guarded


def test_what_is_seen_stays_as_it_is():
    for text in ("gate 1: 3 °, [b] <b>", "  two  spaces ", "Équipe 九 علي 🚁", ""):
        assert printable(text) == text


def test_what_is_not_seen_is_shown_by_its_number():
    assert printable("\x1b[2J\x07") == r"\x1b[2J\x07"
    assert printable("a\r\nb\tc\u2028d") == "a  b c d"
    assert printable("\u202eevil\udc80\U000e0041") == r"\u202eevil\udc80\U000e0041"


@guarded
@given(st.text(st.characters()))
def test_nothing_is_left_that_is_obeyed(text):
    shown = printable(text)
    assert shown.isprintable() and printable(shown) == shown
    assert not {"Cc", "Cf", "Cs", "Zl", "Zp"} & {*map(unicodedata.category, shown)}
    shown.encode()  # no surrogates
