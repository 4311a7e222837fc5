"""Diagrams as SVG pictures: boxes with their ports, and wires of a colour a source."""

from html import escape

from airrace.diagrams.diagram_layout import INPUTS, OUTPUTS, boxes_and_wires, layers, passage

_FONT, _LETTER = 12, 6.6  # px, and how wide a letter is
_LINE, _HEAD, _MARGIN = 17, 26, 10  # px
_COLUMN_GAP, _ROW_GAP = 64, 16  # px
_TITLE = 34
# Dark enough on white, and apart for most eyes.
_COLORS = ("#1b6ca8", "#c2571a", "#2b7a3d", "#7a3e9d", "#a8324a", "#4a5560", "#8a6d00", "#0f7f83")
_STYLE = f"""
text {{ font: {_FONT}px Helvetica, Arial, sans-serif; fill: #1d2733; }}
.name {{ font-weight: bold; }} .title {{ font-size: 16px; font-weight: bold; }}
.box {{ fill: #f5f7fa; stroke: #44515e; }} .port {{ fill: #44515e; }}
.edge {{ fill: #ffffff; stroke: #9aa5b1; stroke-dasharray: 4 3; }}
.wire {{ fill: none; stroke-width: 1.4; opacity: 0.75; }}
"""


def diagram_svg(diagrams) -> str:
    """Returns an SVG picture of diagrams, one below the other, as they were built."""
    parts, width, y = [], 0.0, 0.0
    for diagram in diagrams:
        drawn, w, h = _draw(diagram, y)
        parts.append(drawn)
        width, y = max(width, w), y + h
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {y:.0f}" '
        f'width="{width:.0f}" height="{y:.0f}"><style>{_STYLE}</style>'
        f'<rect width="{width:.0f}" height="{y:.0f}" fill="white"/>{"".join(parts)}</svg>\n'
    )


def _draw(diagram, top: float) -> tuple[str, float, float]:
    """Returns the SVG of a diagram below a height, and its width and height (px)."""
    boxes, wires = boxes_and_wires(diagram)
    rows = layers(boxes, wires)
    places, width, height = _placed(boxes, rows)
    top += _TITLE
    title = escape(diagram.get_name())
    parts = [f'<text class="title" x="{_MARGIN}" y="{top - 10}">{title}</text>']
    sources = sorted({(wire.source, wire.output) for wire in wires})
    colors = {source: _COLORS[k % len(_COLORS)] for k, source in enumerate(sources)}
    for wire in wires:
        points = [_port(boxes, places, wire.source, wire.output, "outputs")]
        for layer in range(boxes[wire.source].layer + 1, boxes[wire.sink].layer):
            x, y, w, _ = places[passage(wire, layer)]
            points += [(x, y), (x + w, y)]
        points.append(_port(boxes, places, wire.sink, wire.input, "inputs"))
        parts.append(
            f'<path class="wire" stroke="{colors[wire.source, wire.output]}" '
            f'd="{_curve([(x, y + top) for x, y in points], top + height - 4)}"/>'
        )
    parts += [_box(box, *places[name], top) for name, box in boxes.items() if not box.is_passage]
    return "".join(parts), width, height + _TITLE + _MARGIN


def _curve(points, low: float) -> str:
    """Returns a path: through points from left to right, or back below everything."""
    (x0, y0), (x1, y1) = points[0], points[-1]
    if x1 <= x0:
        reach = 0.8 * _COLUMN_GAP
        return (
            f"M {x0:.0f} {y0:.0f} C {x0 + reach:.0f} {y0:.0f} {x0 + reach:.0f} {low:.0f} "
            f"{(x0 + x1) / 2:.0f} {low:.0f} S {x1 - reach:.0f} {y1:.0f} {x1:.0f} {y1:.0f}"
        )
    path = f"M {x0:.0f} {y0:.0f}"
    for (a, b), (c, d) in zip(points, points[1:]):
        middle = (a + c) / 2
        path += f" C {middle:.0f} {b:.0f} {middle:.0f} {d:.0f} {c:.0f} {d:.0f}"
    return path


def _size(box) -> tuple[float, float]:
    """Returns the width and height of a box (px)."""
    if box.is_passage:
        return 0.0, 0.0
    letters = max(map(len, box.inputs), default=0) + max(map(len, box.outputs), default=0)
    name = 0 if box.name in (INPUTS, OUTPUTS) else len(box.name) + 2
    lines = max(len(box.inputs), len(box.outputs))
    return max((letters + 5) * _LETTER, name * (_LETTER + 0.8)), _HEAD + lines * _LINE + 4


def _placed(boxes, rows) -> tuple[dict, float, float]:
    """Returns the upper left corner, width and height of each box, and those of all (px)."""
    sizes = {name: _size(box) for name, box in boxes.items()}
    heights = [sum(sizes[n][1] for n in row) + _ROW_GAP * (len(row) - 1) for row in rows]
    places, x = {}, float(_MARGIN)
    for row, height in zip(rows, heights):
        width = max((sizes[n][0] for n in row), default=0.0)
        y = (max(heights) - height) / 2
        for name in row:
            w, h = sizes[name]
            # A passage is as wide as its layer.
            places[name] = (x, y, width, h) if h == 0.0 else (x + (width - w) / 2, y, w, h)
            y += h + _ROW_GAP
        x += width + _COLUMN_GAP
    return places, x - _COLUMN_GAP + _MARGIN, max(heights) + 2.5 * _ROW_GAP


def _port(boxes, places, name, port, side) -> tuple[float, float]:
    """Returns where a port is (px)."""
    x, y, w, _ = places[name]
    k = getattr(boxes[name], side).index(port)
    return (x + w if side == "outputs" else x), y + _HEAD + _LINE * (k + 0.5)


def _box(box, x, y, w, h, top) -> str:
    own = box.name in (INPUTS, OUTPUTS)
    parts = [
        f'<rect class="{"edge" if own else "box"}" x="{x:.0f}" y="{y + top:.0f}" '
        f'width="{w:.0f}" height="{h:.0f}" rx="5"/>',
        f'<text class="name" x="{x + w / 2:.0f}" y="{y + top + 17:.0f}" '
        f'text-anchor="middle">{escape(box.name)}</text>',
    ]
    sides = (box.inputs, "start", x, 7), (box.outputs, "end", x + w, -7)
    for ports, anchor, edge, inset in sides:
        for k, port in enumerate(ports):
            middle = y + top + _HEAD + _LINE * (k + 0.5)
            parts.append(
                f'<circle class="port" cx="{edge:.0f}" cy="{middle:.0f}" r="2.5"/>'
                f'<text x="{edge + inset:.0f}" y="{middle + 4:.0f}" '
                f'text-anchor="{anchor}">{escape(port)}</text>'
            )
    return "".join(parts)
