"""Which folders are entries, and the one sentence for those that are none."""

import importlib.metadata

import pytest

from airrace.common.errors import UserError
from airrace.common.resources import models_path
from airrace.league import entry as entry_module
from airrace.league.entry import load_entry
from tests.league.entries import make_entry

SHIPPED = sorted(path.name for path in (models_path() / "entries").iterdir())


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_entries_are_accepted(name):
    entry = load_entry(name)
    assert entry.name == name and entry.config.team and "entry.yaml" in entry.files


def test_an_entry_with_code_and_a_package(tmp_path):
    numpy = importlib.metadata.version("numpy")
    text = f"team: A\nsystems: {{explorer: 'mine:make'}}\npackages: {{numpy: '{numpy}'}}\n"
    folder = make_entry(tmp_path / "herons", text, mine="raise SystemExit  # is not run\n")
    entry = load_entry(folder)
    assert (entry.name, entry.config.team) == ("herons", "A")
    assert set(entry.files) == {"entry.yaml", "mine.py"}


def test_the_digest_is_of_the_files_alone(tmp_path):
    a, b = (load_entry(make_entry(tmp_path / name, x="x = 1\n")) for name in "ab")
    c = load_entry(make_entry(tmp_path / "c", x="x = 2\n"))
    assert a.digest == b.digest != c.digest


@pytest.mark.parametrize("name", ["yaml", "numba", "json", "airrace", "typing", "sys", "cv2"])
def test_the_name_of_a_module_is_refused(tmp_path, name):
    with pytest.raises(UserError, match=f"folder '{name}' has the name of a module") as caught:
        load_entry(make_entry(tmp_path / name))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text, words",
    [
        ("drone: Default\n", "team must be a name of 1 to 60 characters"),
        (f"team: {61 * 'x'}\n", "team must be a name of 1 to 60 characters"),
        ("team: A\nwings: 4\n", "does not fit its schema"),
        ("team: [\n", "is not valid YAML at line"),
        ("team: A\ndrone: Eagle\n", "drone must be a shipped one, .* not 'Eagle'"),
        ("team: A\nautonomy: {seed: 1}\n", "does not fit its schema"),
        ("team: A\nautonomy: {policy: gone.npz}\n", "a file of the entry's folder"),
        ("team: A\nautonomy: {policy: ../outside.npz}\n", "a file of the entry's folder"),
        ("team: A\nautonomy: {perception: {latency: 0.0}}\n", "perception.latency is .* s for all"),
        ("team: A\nautonomy: {planner: {latency: 0.0}}\n", "planner.latency is .* s for all"),
        ("team: A\nautonomy: {controller: {rate: 2000}}\n", "controller.rate must be at most 1000"),
        (
            "team: A\nsystems: {referee: 'good:make'}\n",
            "systems.referee is not a system of the auto",
        ),
        ("team: A\nsystems: {explorer: good}\n", "must be module:callable, not 'good'"),
        ("team: A\nsystems: {explorer: 'gone:make'}\n", "there is no gone.py in the folder"),
        ("team: A\nsystems: {explorer: 'os:abort'}\n", "there is no os.py in the folder"),
        ("team: A\npackages: {gone-with-the-wind: '1'}\n", "wind 1 is not installed here; .* pip"),
        ("team: A\npackages: {numpy: '0.1'}\n", "numpy is here in version .*, not 0.1"),
    ],
)
def test_what_is_wrong_with_entry_yaml_is_said_in_a_sentence(tmp_path, text, words):
    (tmp_path / "outside.npz").touch()
    folder = make_entry(tmp_path / "herons", text, good="")
    with pytest.raises(UserError, match=words) as caught:
        load_entry(folder)
    assert str(caught.value).startswith(str(folder / "entry.yaml"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "code, words",
    [
        (b"def make(:\n", "is no Python: .* at line 1"),
        (b"x = 1\n\0", "is no Python"),
        (b"x = " + 500 * b"(" + 500 * b")", "is no Python"),
        (b"x = " + 20000 * b"-" + b"1", "is no Python"),
        (b"\xff\xfe", "is no Python"),
    ],
)
def test_code_that_is_no_python(tmp_path, code, words):
    folder = make_entry(tmp_path / "herons")
    (folder / "mine.py").write_bytes(code)
    with pytest.raises(UserError, match=f"mine.py {words}"):
        load_entry(folder)


def test_files_that_are_not_accepted(tmp_path, monkeypatch):
    link = make_entry(tmp_path / "link")
    (link / "secret").symlink_to("/etc/passwd")
    with pytest.raises(UserError, match="secret is a symbolic link"):
        load_entry(link)
    large = make_entry(tmp_path / "large", x="1")
    monkeypatch.setattr(entry_module, "MAX_SIZE", 5)
    with pytest.raises(UserError, match="has 2 files of 0 MB: at most 2000"):
        load_entry(large)


@pytest.mark.parametrize("name", ["two words", "-x", "ä"])
def test_names_of_folders(tmp_path, name):
    with pytest.raises(UserError, match="needs another name"):
        load_entry(make_entry(tmp_path / name))


def test_no_entry(tmp_path):
    with pytest.raises(UserError, match="no entry 'nobody'.*airrace new entry.*learned, optimal"):
        load_entry("nobody")
    with pytest.raises(UserError, match="There is no entry"):
        load_entry(tmp_path)
