"""YAML that means the same to every reader, or is refused with its line.

Drake, as PyYAML, reads YAML 1.1: ``010`` is 8 there, ``1:30`` is 90, ``yes`` is true, and of two
equal keys the last one wins. In YAML 1.2 they are 10, a text, a text, and an error. Who writes such
a thing by mistake flies another race than they think, so it has to be written unmistakably.
"""

import re
from pathlib import Path
from typing import Any

import yaml

from airrace.common.errors import UserError

_TAG = "tag:yaml.org,2002:"
_CLEAR = {
    "int": re.compile(r"[-+]?(0|[1-9][0-9]*|0x[0-9a-fA-F]+)"),
    "float": re.compile(
        r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
    ),
    "bool": re.compile("true|True|TRUE|false|False|FALSE"),
    "timestamp": re.compile("(?!)"),
    "str": re.compile("(?![-+]?[0-9][0-9]*_[0-9_]*([.eE][-+.eE0-9_]*)?$).*", re.DOTALL),
}  # of words without quotes, what has one meaning; by what YAML 1.1 takes them for
_LONGEST_NUMBER = 200  # characters: seeds of leagues are long
_MOST_NODES = 1_000_000
_REMEDIES = {
    "int": "a whole number without zeros in front, colons and underscores",
    "float": "a number without colons and underscores",
    "bool": "true or false",
}


def read_yaml(source: str, *, filename: str | Path | None = None, data: str | None = None) -> str:
    """Returns the text of a file, or the one that is given, if all readers of YAML read it alike.

    Args: source: what to call it, such as its path.

    Raises:
        UserError: naming the source, the line, what is there and what to write.
    """
    try:
        text = Path(filename).read_text(encoding="utf-8-sig") if filename else data or ""
        root = yaml.compose(text, yaml.SafeLoader)
        if root is not None:
            _check(root, source, set())
            if _size(root, {}) > _MOST_NODES:
                raise UserError(
                    f"{source} stands for far more by its aliases (*name) than is there; leave "
                    "them out."
                )
    except UnicodeDecodeError:
        raise UserError(f"{source} is not a text file; give a YAML file.") from None
    except OSError as e:
        raise UserError(f"{source} cannot be read: {e.strerror}.") from None
    except ValueError:  # of a name with a zero byte
        raise UserError(f"{source} cannot be read: no file has such a name.") from None
    except yaml.YAMLError as e:
        mark = getattr(e, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        problem = getattr(e, "problem", None) or "it cannot be parsed"
        raise UserError(f"{source} is not valid YAML{where}: {problem}.") from None
    except RecursionError:
        raise UserError(f"{source} is not valid YAML: it is nested too deeply.") from None
    return text


def plain_data(text: str) -> Any:
    """Returns what a text of read_yaml() says, as dicts, lists and plain values."""
    return yaml.load(text, yaml.SafeLoader)


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """Returns how many values a node stands for, its aliases written out.

    Args: known: sizes by the nodes' id, to which those of this one are added.
    """
    if id(node) not in known:
        known[id(node)] = 1  # also of one that is within itself
        parts = node.value if not isinstance(node, yaml.ScalarNode) else ()
        flat = [each for part in parts for each in (part if isinstance(part, tuple) else (part,))]
        known[id(node)] = 1 + sum(_size(each, known) for each in flat)
    return known[id(node)]


def _check(node: yaml.Node, source: str, seen: set[int]) -> None:
    """Checks a node and all below it, each once, however many aliases it has."""
    if id(node) in seen:
        return
    seen.add(id(node))
    if isinstance(node, yaml.ScalarNode):
        _check_scalar(node, source)
    elif isinstance(node, yaml.SequenceNode):
        for each in node.value:
            _check(each, source, seen)
    elif isinstance(node, yaml.MappingNode):
        keys = set()
        for key, value in node.value:
            name = (key.tag, key.value) if isinstance(key, yaml.ScalarNode) else id(key)
            if name in keys:
                raise UserError(
                    f"{source} is not clear at line {key.start_mark.line + 1}: there is another "
                    f"'{key.value}' before; leave one of them out."
                )
            keys.add(name)
            _check(key, source, seen)
            _check(value, source, seen)


def _check_scalar(node: yaml.ScalarNode, source: str) -> None:
    kind = node.tag.removeprefix(_TAG)
    if kind in ("int", "float") and len(node.value) > _LONGEST_NUMBER:
        raise UserError(
            f"{source} has a number of {len(node.value)} characters at line "
            f"{node.start_mark.line + 1}; write one of at most {_LONGEST_NUMBER}."
        )
    is_text = node.style and kind == "str"
    if is_text or kind not in _CLEAR or _CLEAR[kind].fullmatch(node.value):
        return
    remedy = _REMEDIES.get("int" if kind == "str" else kind)
    raise UserError(
        f"{source} is not clear at line {node.start_mark.line + 1}: '{node.value}' means one thing "
        f"in YAML 1.1 and another in YAML 1.2; write {f'{remedy}, or ' if remedy else ''}a text in "
        "quotes."
    )
