"""The public names of airrace keep to the glossary of docs/architecture.md."""

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROW = re.compile(r"^\| `(\w+)` \| [^|]+ \|([^|]*)\|([^|]*)\|$", re.MULTILINE)


def names_of(tree: ast.Module):
    """Yields all public names that a module defines: also those of arguments and of fields."""
    for node in ast.walk(tree):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name) if not name.startswith("_"):
                yield name
                if isinstance(node, ast.FunctionDef):
                    arguments = node.args
                    for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs):
                        yield each.arg
            case (
                ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)])
            ) if not name.startswith("_"):
                yield name


def words_of(name: str) -> set[str]:
    """Returns the words of a name, in lower case: {"map", "estimator"} of MAP_ESTIMATORS."""
    parts = re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower().split("_")
    return {part.removesuffix("s") for part in parts}


@pytest.fixture(scope="module")
def places():
    """Word to where public names have it: {word: {"folder/file.py": {names}}}."""
    found = defaultdict(lambda: defaultdict(set))
    for path in (ROOT / "airrace").rglob("*.py"):
        where = path.relative_to(ROOT / "airrace").as_posix()
        if where.startswith("lcmtypes/"):
            continue
        for name in (path.stem, *names_of(ast.parse(path.read_text(encoding="utf-8")))):
            for word in words_of(name):
                found[word][where].add(name)
    return found


def rows():
    """Returns the glossary: (word, where it stands, what is not said for it), as texts."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    return ROW.findall(text[text.index("## Words") :])


@pytest.mark.parametrize("word, where, others", rows())
def test_a_word_means_one_thing(places, word, where, others):
    """It stands in the places that are named, if any are, and others do not stand for it."""
    used = {file: names for w in words_of(word) for file, names in places[w].items()}
    assert used, "no public name has it"
    allowed = tuple(re.findall(r"`([^`]+)`", where))
    if allowed:
        assert {file: n for file, n in used.items() if not file.startswith(allowed)} == {}
    for other in re.findall(r"`([^`]+)`", others):
        assert dict(places[other]) == {}, other


def test_the_glossary_is_read():
    assert len(rows()) >= 12
