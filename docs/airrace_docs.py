"""A Sphinx extension: a page a module, docstrings as they are written, systems as boxes."""

import html
import json
import pkgutil
import re
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive

import airrace

_SKIPPED = re.compile(r"\.(lcmtypes|__main__)\b")
_ROOT = Path(airrace.__file__).resolve().parents[1]
_FILE_LINK = re.compile(r"\[([^\]]*)\]\(\.\./([^)]+)\)")
# What would be markup, but in our docstrings is a letter of a formula or a file's name.
_MARKUP = re.compile(r"([*|])|(\w)_(?=\W|$)")


class PydrakeSystem(Directive):
    """Draws the block in which a LeafSystem's docstring lists its ports."""

    has_content = True

    def run(self):
        name, ports = parse_system(self.content)
        rows = zip_longest_rows(ports["input_ports"], ports["output_ports"])
        cells = "".join(
            f"<tr><td>{_port(a, '{} &rarr;')}</td>{middle}<td>{_port(b, '&rarr; {}')}</td></tr>"
            for a, b, middle in rows_with_name(rows, name)
        )
        return [nodes.raw("", f'<table class="pydrake-system">{cells}</table>', format="html")]


def parse_system(lines) -> tuple[str, dict]:
    """Returns the name in a ``pydrake_system`` block, and its ports.

    Args:
        lines: of the block.

    Returns:
        The name, and ``input_ports`` and ``output_ports``, each a list of what the
        block says of one port.
    """
    name, ports, current = "", {"input_ports": [], "output_ports": []}, None
    for line in filter(None, map(str.strip, lines)):
        key, _, value = line.partition(":")
        if key == "name":
            name = value.strip()
        elif key in ports and not value:
            current = ports[key]
        elif line.startswith("- ") and current is not None:
            current.append(line[2:])
        elif current:
            current[-1] += " " + line
        else:
            raise ValueError(f"'{line}' does not belong into a pydrake_system block")
    return name, ports


def zip_longest_rows(inputs, outputs) -> list:
    """Returns pairs of an input and an output, '' where there is none; at least one."""
    count = max(len(inputs), len(outputs), 1)
    pad = [side + [""] * (count - len(side)) for side in (inputs, outputs)]
    return list(zip(*pad))


def rows_with_name(rows, name):
    """Yields each row with the cell of the name, which spans all rows, in the first."""
    for k, (a, b) in enumerate(rows):
        span = f'<th rowspan="{len(rows)}">{html.escape(name)}</th>' if k == 0 else ""
        yield a, b, span


def _port(text: str, arrow: str) -> str:
    """Returns a port with an arrow, and in small letters what the block says about it."""
    if not text:
        return ""
    port, _, note = text.partition(" ")
    small = f" <small>{html.escape(note)}</small>" if note else ""
    return arrow.format(f"<code>{html.escape(port)}</code>{small}")


def plain_docstring(app, what, name, obj, options, lines) -> None:
    """Keeps what looks like markup in a docstring, but is none, from being taken for it."""
    in_block = False
    for k, line in enumerate(lines):
        indented = line.startswith("    ")
        in_block = (in_block and (indented or not line)) or line.rstrip().endswith("::")
        if not in_block:
            lines[k] = _outside_literals(line)


def _outside_literals(line: str) -> str:
    """Escapes markup in what is not between double backquotes."""
    parts = line.split("``")
    parts[::2] = [_MARKUP.sub(_escaped, part) for part in parts[::2]]
    return "``".join(parts)


def _escaped(match) -> str:
    return f"\\{match[1]}" if match[1] else f"{match[2]}\\_"


def link_code(app, name, source) -> None:
    """Makes links of our pages to files of the repository links to what the site has of them.

    In the repository ``../airrace/track/rules.py`` is a file; on the site it is a module of
    the API pages; lessons and examples are pages, too. The text of a link to any other file becomes
    the file's path.
    """
    source[0] = _FILE_LINK.sub(_linked, source[0])


def _linked(match) -> str:
    text, path = match.groups()
    if path.startswith("airrace/") and path.endswith(".py"):
        module = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        return f"{{py:mod}}`{text} <{module}>`"
    if found := re.fullmatch(r"notebooks/(\w+)\.ipynb|examples/(\w+)\.py", path):
        lesson, example = found.groups()
        return f"[{text}](lessons/{lesson}.md)" if lesson else f"[{text}](examples/{example}.md)"
    return f"`{path}`"


def lesson_page(path: Path) -> str:
    """Returns a notebook as Markdown: its text and its code, without what running it shows."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "code":
            language = "text" if re.search(r"(?m)^[%!]", text) else "python"  # of IPython
            parts.append(f"```{language}\n{text}\n```")
        else:
            text = re.sub(r"\$([^$]+)\$", r"`\1`", text)  # formulas as they are written
            parts.append(text.replace("](../docs/", "](../"))
    run = (
        f"This is the notebook `notebooks/{path.name}`: open it with Jupyter to run and change it."
    )
    return "\n\n".join([parts[0], run, *parts[1:]]) + "\n"


def example_page(path: Path) -> str:
    """Returns a script as a page, headed by the first sentence of its docstring."""
    text = path.read_text(encoding="utf-8")
    title = re.match(r'"""(.+?)[:.?\n]', text)[1]
    return f"# {title}\n\n`examples/{path.name}`\n\n```python\n{text}```\n"


def write_lessons(app) -> None:
    """Writes a page of every notebook and every example, in docs/lessons and docs/examples."""
    notebooks = sorted(
        (_ROOT / "notebooks").glob("*.ipynb"), key=lambda path: int(path.name.partition("_")[0])
    )
    _write_folder(app.srcdir / "lessons", "Lessons", notebooks, lesson_page)
    examples = sorted((_ROOT / "examples").glob("*.py"))
    _write_folder(app.srcdir / "examples", "Examples", examples, example_page)


def _write_folder(folder: Path, title: str, sources: list, page) -> None:
    folder.mkdir(exist_ok=True)
    names = [source.stem for source in sources]
    listed = "\n".join(names)
    pages = dict(zip(names, map(page, sources)))
    pages["index"] = f"# {title}\n\n```{{toctree}}\n:maxdepth: 1\n\n{listed}\n```\n"
    for name, text in pages.items():
        _write_if_new(folder / f"{name}.md", text)


def _write_if_new(page: Path, text: str) -> None:
    """Writes a page unless it is there as it is: Sphinx reads again what has changed."""
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def modules() -> list:
    """Returns the names of all modules of airrace, packages first."""
    found = pkgutil.walk_packages(airrace.__path__, "airrace.")
    return ["airrace", *(m.name for m in found if not _SKIPPED.search(m.name))]


def write_pages(app) -> None:
    """Writes a page of every package, with all modules in it, below docs/api."""
    folder = app.srcdir / "api"
    folder.mkdir(exist_ok=True)
    names = modules()
    packages = [n for n in names if any(m.startswith(n + ".") for m in names)]
    for package in packages:
        inside = [n for n in names if n.rpartition(".")[0] == package and n not in packages]
        parts = [_title(package, "="), f".. automodule:: {package}\n   :no-members:\n"]
        parts += [_title(n, "-") + f"\n.. automodule:: {n}\n" for n in inside]
        _write_if_new(folder / f"{package}.rst", "\n".join(parts))
    listed = "\n".join(f"   {package}" for package in packages)
    index = f"{_title('API', '=')}\n.. toctree::\n   :maxdepth: 2\n\n{listed}\n"
    (folder / "index.rst").write_text(index, encoding="utf-8")


def _title(text: str, line: str) -> str:
    return f"{text}\n{line * len(text)}\n"


def setup(app):
    """Registers what is above; called by Sphinx."""
    app.add_directive("pydrake_system", PydrakeSystem)
    # Before napoleon, which makes markup of its own.
    app.connect("autodoc-process-docstring", plain_docstring, priority=100)
    app.connect("source-read", link_code)
    app.connect("builder-inited", write_pages, priority=100)
    app.connect("builder-inited", write_lessons, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
