import pytest

from airrace.common.errors import UserError
from airrace.common.patience import VARIABLE, patient


def test_waits_are_as_long_as_they_are(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert patient(5.0) == 5.0
    monkeypatch.setenv(VARIABLE, "")
    assert patient(5.0) == 5.0


def test_waits_are_multiplied(monkeypatch):
    monkeypatch.setenv(VARIABLE, "20")
    assert patient(5.0) == 100.0
    monkeypatch.setenv(VARIABLE, "1.5")
    assert patient(2.0) == 3.0


@pytest.mark.parametrize("text", ["twenty", "0.5", "-3", "nan", "inf"])
def test_nonsense_is_refused_in_a_sentence(monkeypatch, text):
    monkeypatch.setenv(VARIABLE, text)
    with pytest.raises(UserError, match=f"AIRRACE_PATIENCE={text} must be a number of at least 1"):
        patient(5.0)
