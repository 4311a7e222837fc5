"""A Sphinx extension: tables that are made of the code, so that they cannot be out of date.

A page has a comment ``<!-- airrace-reference: ARGUMENT -->``, and right below it a paragraph for
those who read the page as it is in the repository. On the site, the directive ``airrace-reference``
takes the place of both. It writes, by its argument:

- ``scenario``: every field of a scenario, with its type, default, range, and comment;
- ``presets``: what the camera's presets mean;
- ``imu_presets``: what the presets of the IMU mean;
- ``systems``: the systems of the autonomy and their ports;
- ``ports``: what crosses those ports;
- ``dialects``: what each number on the wire means to clients of the AI Grand Prix;
- ``options COMMAND``: the options of a subcommand of ``airrace``;
- ``measurement NAME [TITLE]``: the tables of docs/measurements/NAME.json, which
  ``python -m benchmarks.NAME --json docs/measurements/NAME.json`` wrote, or only those whose
  titles begin so;
- ``season``: the ranking of docs/season/league.json, whose page is written beside the others.
"""

import ast
import dataclasses as dc
import inspect
import io
import json
import math
import re
import tokenize
import typing
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from pydrake.systems.framework import PortDataType, System
from sphinx.util.docutils import SphinxDirective

from airrace.league.page import PAGE, write_page
from airrace.scenario import Scenario, imu_config
from airrace.scenario.camera_config import PRESETS, EffectsConfig
from airrace.scenario.checks import RANGES
from airrace.systems.estimation.air_learner import AirLearner
from airrace.systems.estimation.rotor_learner import RotorLearner

_MEASUREMENTS = Path(__file__).parent / "measurements"
_SEASON = "season"  # in docs/ and in what is built
_COMMENT = re.compile(r"^<!-- airrace-reference: (.+) -->\n(?:.+\n)*", re.MULTILINE)
_DRAKE = "https://drake.mit.edu/doxygen_cxx/structdrake"
_DRAKES = {
    "SimulatorConfig": f"{_DRAKE}_1_1systems_1_1_simulator_config.html",
    "MultibodyPlantConfig": f"{_DRAKE}_1_1multibody_1_1_multibody_plant_config.html",
}


class Field(NamedTuple):
    """A field of a dataclass, as its source has it.

    Attributes:
        name: of the field.
        type: as it is written.
        comment: behind the field or, without one there, right above it.
        heading: the comment above the field that begins a group of fields, or "".
    """

    name: str
    type: str
    comment: str
    heading: str


class AirraceReference(SphinxDirective):
    """Writes what its argument asks for."""

    required_arguments = 1
    optional_arguments = 1
    final_argument_whitespace = True

    def run(self):
        what, *rest = self.arguments
        text = _MAKERS[what](*rest)
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def write_directives(app, name, source) -> None:
    """Puts directives in the place of the comments that ask for them."""
    source[0] = _COMMENT.sub(r"```{airrace-reference} \1\n```\n", source[0])


def scenario_reference() -> str:
    """Returns Markdown with a table of every part of a scenario."""
    return "\n".join(_section("", Scenario, Scenario()))


def _section(path: str, cls, default) -> list[str]:
    """Returns the lines of a part of the scenario, and of the parts in it."""
    lines, parts = [], []
    if path:
        lines += [f"(scenario-{_anchor(path)})=", f"## `{path}`", "", *_paragraphs(cls), ""]
    for heading, fields in _groups(fields_of(cls)):
        if heading:
            lines += [f"**{heading.rstrip('.')}**", ""]
        lines += ["| field | type | default | range | meaning |", "|---|---|---|---|---|"]
        for field in fields:
            value, name = getattr(default, field.name), _join(path, field.name)
            part = _part_of(cls, field.name)
            cells = [f"`{field.name}`", field.type, yaml_value(value), _range(name, field.type)]
            if part is not None:
                is_list = isinstance(value, list)
                name += "[]" * is_list
                cells[1:] = [f"[{'list' if is_list else 'fields'}](#scenario-{_anchor(name)})"]
                cells += ["`[]`" if is_list else "" if value is not None else "`null`", ""]
                parts.append((name, part, part() if is_list or value is None else value))
            meaning = field.comment
            if part is not None and not meaning:
                name = part.__name__
                meaning = f"Drake's own {name}." if name in _DRAKES else _paragraphs(part)[0]
            lines.append(_row(*cells, escape(meaning)))
        lines.append("")
    for part in parts:
        lines += _drakes(*part) if part[1].__name__ in _DRAKES else _section(*part)
    return lines


def _drakes(path: str, cls, default) -> list[str]:
    """Returns the lines of a struct of Drake's own."""
    rows = [
        _row(f"`{field.name}`", yaml_value(getattr(default, field.name)))
        for field in cls.__fields__
    ]
    return [
        f"(scenario-{_anchor(path)})=",
        f"## `{path}`",
        "",
        f"Drake's own [{cls.__name__}]({_DRAKES[cls.__name__]}), which says what its fields mean.",
        "",
        "| field | default here |",
        "|---|---|",
        *rows,
        "",
    ]


def presets() -> str:
    """Returns Markdown with a table of the camera's presets."""
    return _presets("effect", PRESETS, EffectsConfig, yaml_value)


def imu_presets() -> str:
    """Returns Markdown with a table of the presets of the IMU."""

    def rounded(value):
        return "none" if value == math.inf else f"`{value:.3g}`"

    return _presets("error", imu_config.PRESETS, imu_config.ImuErrorsConfig, rounded)


def _presets(head: str, presets: dict, config: type, text: Callable[[typing.Any], str]) -> str:
    """Returns a table of presets, whose fields have comments in a class of the scenario."""
    rows = []
    for field in fields_of(config):
        values = (text(getattr(preset, field.name)) for preset in presets.values())
        rows.append(_row(f"`{field.name}`", *values, escape(field.comment)))
    heads = [head, *(f"`{preset}`" for preset in presets), "meaning"]
    return "\n".join([_row(*heads), "|" + "---|" * len(heads), *rows])


def dialects() -> str:
    """Returns Markdown with a table of both dialects, and who says so of the official one."""
    from airrace.mavlink.dialects import DIALECTS, Dialect

    heads = ["what", *(f"`{name}`" for name in DIALECTS), "who says so"]
    rows = [_row(*heads), "|" + "---|" * len(heads)]
    for field in dc.fields(Dialect):
        values = (_plain(getattr(dialect, field.name)) for dialect in DIALECTS.values())
        rows.append(_row(escape(field.metadata["what"]), *values, field.metadata["says"]))
    return "\n".join(rows)


def _plain(value) -> str:
    """Returns a value of a dialect in a cell: numbers with few digits, one after the other."""
    if isinstance(value, bool) or value is None:
        return yaml_value(value)
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_plain(each)}" for key, each in value.items()) or "none"
    if hasattr(value, "_asdict"):
        return " ".join(name for name, each in value._asdict().items() if each) or "local"
    if isinstance(value, tuple) and isinstance(value[0], tuple):
        if any(abs(x) != 1.0 for x, _ in value):  # not corners, but a curve
            return ", ".join(f"{x:.4g}: {y:.4g}" for x, y in value)
        return ", ".join("BF"[x > 0] + "RL"[y > 0] for x, y in value)
    if isinstance(value, tuple):
        return " ".join(f"{each:.4g}" for each in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def systems() -> str:
    """Returns Markdown with a table of the autonomy's systems and their ports."""
    lines = ["| system | inputs | outputs |", "|---|---|---|"]
    for name, system in _default_systems():
        inputs = (system.get_input_port(k) for k in range(system.num_input_ports()))
        outputs = (system.get_output_port(k) for k in range(system.num_output_ports()))
        ports = [", ".join(f"`{port.get_name()}`" for port in each) for each in (inputs, outputs)]
        lines.append(_row(f"`{name}`", *ports))
    return "\n".join(lines)


def _default_systems() -> list[tuple[str, System]]:
    """Returns the autonomy's systems by their names, as scenarios make them by default."""
    from airrace.diagrams.variants import ESTIMATORS

    makers = {
        name: (make, Scenario(estimator=estimator))
        for estimator, variant in reversed(ESTIMATORS.items())
        for name, make in variant.systems.items()
    }
    return [(name, make(scenario)) for name, (make, scenario) in makers.items()]


def port_meanings(scenario: Scenario) -> dict[str, tuple[float | None, str, str]]:
    """Returns of every port how often it is new (Hz), its type if no system makes it, and what."""
    frames, state = scenario.camera.fps, scenario.state_estimate.rate
    rotors, explorer = scenario.rotors.rate, scenario.explorer.rate
    control, imu = scenario.controller.rate, scenario.imu.rate
    return {
        "camera_view": (
            frames,
            "CameraView",
            "a picture in grey levels, drawn only where the detector looks",
        ),
        "camera_image": (
            frames,
            "ImageRgba8U",
            "the whole picture in colour, if a system of yours asks for it",
        ),
        "camera_grey": (
            frames,
            "ImageGrey8U",
            "the whole picture in grey levels, if a system of yours asks for it",
        ),
        "camera_image_time": (frames, "", "when the picture was taken (s)"),
        "camera_info": (None, "CameraInfo", "size, lens and place of the camera; constant"),
        "detections": (
            frames,
            "",
            "markers in the picture: corners (px), poses in the camera's frame (m)",
        ),
        "state_estimate": (
            state,
            "",
            "State: time (s), quaternion w x y z of R_WB, p_WB (m), w_WB (rad/s), v_WB (m/s), in W",
        ),
        "filtered_estimate": (control, "", "State, filtered, and predicted to now"),
        "disturbance": (control, "", "acceleration that nothing explains, in W (m/s²)"),
        "disturbance_moment": (control, "", "likewise a moment, in B (N m)"),
        "rotor_factors": (
            RotorLearner.RATE,
            "",
            "by what the thrust of each rotor, as in the drone's file, is to be multiplied",
        ),
        "air": (AirLearner.RATE, "", "Air: drag by mass (1/s, 1/m), and the wind (m/s)"),
        "path_clock": (control, "", "PathClock: how far plans wait for the drone"),
        "rotor_speeds": (rotors, "", "as measured, one a rotor (rad/s)"),
        "rotor_status": (
            rotors,
            "",
            "RotorStatus: time (s), then commanded and measured speeds (rad/s)",
        ),
        "rotor_losses": (
            scenario.rotor_monitor.rate,
            "",
            "when each rotor was found lost (s); infinite for those that work",
        ),
        "imu": (
            imu,
            "",
            "the newest 10 samples: time (s), angular velocity (rad/s) and specific force (m/s²)",
        ),
        "imu_history": (imu, "", "samples of the last seconds, for `gate_slam`"),
        "imu_silence": (imu, "", "time since the newest sample (s)"),
        "corrections": (
            frames,
            "",
            "Navigation at a picture's exposure, that the strapdown goes on from",
        ),
        "gate_map": (frames, "", "gates and markers found so far, with their uncertainty"),
        "slam_state": (frames, "", "belief of the estimator, for logs"),
        "estimate_fault": (frames, "", "why the estimate cannot be flown by; empty while it can"),
        "estimate_drift": (frames, "", "how far off the estimate may be (m)"),
        "exploration_reference": (
            explorer,
            "",
            "Reference: p_WB and four derivatives (m, s), yaw and two derivatives (rad, s)",
        ),
        "explorer_status": (explorer, "", "what the search does, and has found"),
        "lap_plan": (
            scenario.planner.rate,
            "",
            "entry, and lap that is repeated until the next plan; NO_PLAN before the first",
        ),
        "reference": (control, "", "Reference, to be followed now"),
        "rotor_speed_command": (control, "", "one speed a rotor (rad/s), 0 or more"),
        "policy_status": (control, "PolicyStatus", "whether a network flies; only with `policy:`"),
    }


def ports() -> str:
    """Returns Markdown with a table of all ports of the table of systems: size, rate, meaning."""
    meanings, kinds = port_meanings(Scenario()), port_kinds()
    lines = ["| port | type, or numbers | Hz | what |", "|---|---|---|---|"]
    for name, (rate, given, meaning) in meanings.items():
        hertz = "" if rate is None else f"{rate:g}"
        lines.append(_row(f"`{name}`", kinds.get(name) or f"`{given}`", hertz, meaning))
    return "\n".join(lines)


def port_kinds() -> dict[str, str]:
    """Returns what each port of the autonomy's systems holds; "" where no system makes it."""
    kinds: dict[str, str] = {}
    for _, system in _default_systems():
        inputs = [system.get_input_port(k) for k in range(system.num_input_ports())]
        outputs = [system.get_output_port(k) for k in range(system.num_output_ports())]
        for port in (*inputs, *outputs):
            kind = ""
            if port.get_data_type() == PortDataType.kVectorValued:
                kind = str(port.size())
            elif port in outputs:
                kind = f"`{type(port.Allocate().get_value()).__name__}`"
            kinds[port.get_name()] = kinds.get(port.get_name()) or kind
    return kinds


def options(command: str) -> str:
    """Returns Markdown with a table of a subcommand's options for every group of them.

    Args:
        command: such as "race", or "hitl autonomy".
    """
    from airrace.commands.app import make_app

    app = make_app()
    parameters = app.default_parameter
    for name in command.split():
        app = app[name]
    groups = {}
    for argument in app.assemble_argument_collection(
        default_parameter=parameters, parse_docstring=True
    ):
        if argument.parse and argument.show and argument.names != ("*",):
            group = argument.parameter.group[0]
            groups.setdefault((group.sort_key, group.name), []).append(_option(argument))
    lines = []
    # A subcommand's own options are in a group of Cyclopts's, whose key is no number.
    for (_, name), rows in sorted(groups.items(), key=lambda item: _order(item[0][0])):
        title = "Options" if name == "Parameters" else name
        lines += [f"**{title}**", "", "| option | meaning |", "|---|---|", *rows, ""]
    return "\n".join(lines)


def _order(key) -> int:
    return key if isinstance(key, int) else 0


def _option(argument) -> str:
    """Returns the row of an option."""
    takes = argument.parameter.metavar or _takes(argument.hint)
    names = sorted(argument.names, key=len)
    text = ", ".join(f"`{name}`" for name in names)
    return _row(f"{text} `{takes}`" if takes else text, escape(argument.parameter.help or ""))


def _takes(hint) -> str:
    """Returns what an option of a type takes, or "" if nothing."""
    hints = [each for each in typing.get_args(hint) if each is not type(None)]
    if typing.get_origin(hint) is typing.Literal:
        return "|".join(map(str, typing.get_args(hint)))
    if len(hints) == 1:
        return _takes(hints[0])
    return {bool: "", int: "N", float: "X"}.get(hint, "TEXT")


def fields_of(cls) -> list[Field]:
    """Returns the fields of a dataclass with their comments, from its source."""
    source = inspect.getsource(cls)
    lines = source.splitlines()
    comments = {
        token.start[0]: token.string.lstrip("# ")
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    fields = []
    for node in ast.parse(source).body[0].body:
        if not isinstance(node, ast.AnnAssign):
            continue
        first = node.lineno
        while first - 1 in comments and lines[first - 2].lstrip().startswith("#"):
            first -= 1
        above = " ".join(comments[line] for line in range(first, node.lineno))
        behind = comments.get(node.end_lineno, "")
        # A comment after an empty line is about all fields below it.
        begins = above and not lines[first - 2].strip()
        fields.append(
            Field(
                name=node.target.id,
                type=_type(node.annotation),
                comment=behind or ("" if begins else above),
                heading=above if begins else "",
            )
        )
    return fields


def _type(annotation) -> str:
    """Returns a type as a reader of YAML knows it."""
    return re.sub(r" \| None$", " or null", ast.unparse(annotation))


def _part_of(cls, name: str):
    """Returns the class of a field that has fields of its own, or None."""
    hint = typing.get_type_hints(cls)[name]
    for each in (hint, *typing.get_args(hint)):
        if dc.is_dataclass(each) or getattr(each, "__name__", "") in _DRAKES:
            return each
    return None


def _groups(fields):
    """Yields pairs of a heading and its fields."""
    starts = [k for k, field in enumerate(fields) if k == 0 or field.heading]
    for start, end in zip(starts, [*starts[1:], len(fields)]):
        yield fields[start].heading, fields[start:end]


def _paragraphs(cls) -> list[str]:
    """Returns the lines of a class's docstring."""
    return inspect.cleandoc(cls.__doc__).replace("``", "`").splitlines()


def _range(name: str, type_name: str) -> str:
    """Returns what a number may be."""
    elements = type_name.startswith("list")
    low, high = RANGES.get(name + "[]" * elements, (None, None))
    each = "each " if elements else ""
    if low is None:
        return "above 0" if type_name.startswith(("int", "float")) else ""
    if high == float("inf"):
        return f"{each}at least {low}"
    return f"{each}{low} to {high}"


def yaml_value(value) -> str:
    """Returns a value as YAML has it, as code."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif value is None or value == "":
        text = '""' if value == "" else "null"
    else:
        text = str(list(value)) if isinstance(value, tuple) else str(value)
    return f"`{text}`"


def escape(text: str) -> str:
    """Returns text in which nothing is markup but what is between backquotes."""
    parts = text.split("`")
    parts[::2] = [re.sub(r"([*<>\[\]_])", r"\\\1", part) for part in parts[::2]]
    return "`".join(parts)


def _row(*cells) -> str:
    cells = (cell.replace("\n", " ").replace("|", "\\|") for cell in cells)
    return f"| {' | '.join(cells)} |"


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _anchor(path: str) -> str:
    return path.replace(".", "-").replace("[]", "").replace("_", "-")


def measurement(arguments: str) -> str:
    """Returns Markdown with the tables that a benchmark printed, and where they come from."""
    name, _, beginning = arguments.partition(" ")
    written = json.loads((_MEASUREMENTS / f"{name}.json").read_text(encoding="utf-8"))
    tables = [each for each in written["tables"] if each["title"].startswith(beginning)]
    if not tables:
        raise ValueError(f"no table of {name}.json begins with '{beginning}'")
    lines = []
    for table in tables:
        title, *notes = table["title"].splitlines()
        headings = table["headings"] or [" "] * len(table["rows"][0])
        lines += [f"**{escape(title)}**", "", *map(escape, notes), ""]
        lines += [_row(*map(escape, headings)), "|---" * len(headings) + "|"]
        lines += [_row(*map(escape, row)) for row in table["rows"]]
        lines.append("")
    source = f"of commit {written['commit']}, on {written['date']} ({written['machine']})"
    return "\n".join([*lines, f"Printed by `{written['command']}` {source}.", ""])


def season() -> str:
    """Returns Markdown with the ranking of the season that was flown, and a link to its page."""
    league = _read_season()
    teams = {entry["entry"]: entry["team"] for entry in league["settings"]["entries"]}
    heads = ["place", "entry", "team", "finished", "step", "mean lap (s)", "best lap (s)"]
    lines = [_row(*heads), "|---" * len(heads) + "|"]
    for each in league["ranking"]:
        laps = [each["mean_lap_s"], each["best_lap_s"]]
        lines.append(
            _row(
                str(each["place"]),
                f"`{each['entry']}`",
                escape(teams[each["entry"]]),
                f"{each['finished']} of {each['races']}",
                f"{100 * each['step']:.0f} %",
                *("–" if lap is None else f"{lap:.3f}" for lap in laps),
            )
        )
    return "\n".join([*lines, "", f'<a href="{_SEASON}/{PAGE}">The page of this season</a>', ""])


def write_season_page(app, error) -> None:
    """Writes the page of the season, without replays, into what was built."""
    if error is None:
        folder = Path(app.outdir) / _SEASON
        folder.mkdir(exist_ok=True)
        write_page(folder, _read_season())


def _read_season() -> dict:
    # Not by read_league(): it was flown when league.json had no hashes of the files beside it.
    text = (Path(__file__).parent / _SEASON / "league.json").read_text(encoding="utf-8")
    return json.loads(text)


_MAKERS = {
    "season": season,
    "measurement": measurement,
    "scenario": scenario_reference,
    "presets": presets,
    "imu_presets": imu_presets,
    "dialects": dialects,
    "systems": systems,
    "ports": ports,
    "options": options,
}


def setup(app):
    """Registers what is above; called by Sphinx."""
    app.add_directive("airrace-reference", AirraceReference)
    app.connect("source-read", write_directives)
    app.connect("build-finished", write_season_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
