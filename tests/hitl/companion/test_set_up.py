import io

from rich.console import Console

from airrace.hitl.companion.set_up import SetUpDisplay


def shown(**options):
    output = io.StringIO()
    with SetUpDisplay("board[1]", Console(file=output, width=100, **options)) as display:
        display.step("connecting [bold]")
        display.step("installing")
        display.show(3, 12)
    return output.getvalue()


def test_every_step_is_a_line_without_a_terminal():
    assert shown() == "airrace: board[1]: connecting [bold]\nairrace: board[1]: installing\n"


def test_bar_on_a_terminal():
    text = shown(force_terminal=True, color_system=None)
    assert "board[1]: installing" in text and "25%" in text
    assert "airrace:" not in text
