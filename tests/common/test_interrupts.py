import signal

import pytest

from airrace.common.interrupts import interrupts_held, sigterm_as_ctrl_c


def test_sigterm_as_ctrl_c():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), sigterm_as_ctrl_c():
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupts_wait(number):
    steps = []
    with pytest.raises(KeyboardInterrupt), sigterm_as_ctrl_c():
        with interrupts_held():
            signal.raise_signal(number)
            steps.append("the row is written")
        steps.append("too late")
    assert steps == ["the row is written"]


def test_without_interrupts_nothing_happens():
    before = signal.getsignal(signal.SIGINT)
    with interrupts_held():
        pass
    assert signal.getsignal(signal.SIGINT) == before
