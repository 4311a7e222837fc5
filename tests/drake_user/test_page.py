"""What docs/drake.md shows runs as it is, one piece after the other."""

import re

import numpy as np

from airrace.common.resources import models_path

PAGE = models_path().parent / "docs" / "drake.md"


def test_the_page_runs():
    pieces = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    names: dict = {}
    for piece in pieces:
        exec(compile(piece, str(PAGE), "exec"), names)
        lines = [line for line in piece.splitlines() if line and "import " not in line]
        assert len(lines) <= 15, "it is to be read at a glance"
    simulator, other = names["simulator"], names["other"]
    simulator.AdvanceTo(3.5)
    state = names["simulation"].GetOutputPort("truth.state")
    states = [
        state.Eval(names["simulation"].GetMyContextFromRoot(each.get_context()))
        for each in (simulator, other)
    ]
    np.testing.assert_array_equal(*states)
    assert len(names["heights"]) == 20
    linear, K = names["linear"], names["K"]
    assert np.linalg.eigvals(linear.A() - linear.B() @ K).real.max() < -0.1
