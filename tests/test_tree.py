"""What tests may import."""

import re
from pathlib import Path

HERE = Path(__file__).parent


def test_tests_do_not_import_benchmarks():
    """Worlds that both need are in tests/worlds/."""
    pattern = re.compile(r"^\s*(from|import) benchmarks\b", re.MULTILINE)
    assert not [path for path in HERE.rglob("*.py") if pattern.search(path.read_text())]
