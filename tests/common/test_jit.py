"""Functions as machine code, and where it is kept."""

import collections
import math
import os
import shutil
import subprocess
import sys
import types

import numba
import numpy as np
import pytest

from airrace.common import jit
from airrace.common.errors import UserError
from airrace.common.jit import all_finite, compilable, compiled, inlined


@compilable
def square(x):
    return x * x


@inlined
def added(x, y):
    return x + y


@compiled
def sum_of_squares(vector):
    total = 0.0
    for x in vector:
        total = added(total, square(x))
    return total


@compiled
def quotient(a, b):
    return a / b


def test_compilable_functions_stay_python():
    assert sum_of_squares(np.array([1.0, 2.0, 3.0])) == 14.0
    np.testing.assert_array_equal(square(np.array([1.0, 2.0])), [1.0, 4.0])
    np.testing.assert_array_equal(added(np.array([1.0, 2.0]), 1.0), [2.0, 3.0])


def test_a_division_by_zero_is_as_with_arrays():
    assert quotient(1.0, 0.0) == math.inf and math.isnan(quotient(0.0, 0.0))


def test_the_level_of_optimization_is_ours_unless_the_user_sets_one():
    assert numba.config.OPT == int(os.environ["NUMBA_OPT"])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_all_finite(bad):
    assert all_finite(np.zeros(0)) and all_finite(np.array([1e300, -1.0]))
    for i in range(3):
        vector = np.ones(3)
        vector[i] = bad
        assert not all_finite(vector)


@pytest.mark.slow
def test_machine_code_is_kept_and_goes_with_its_sources(tmp_path):
    """A change in any file with such functions makes all code anew: one may call another."""
    package = tmp_path / "package"
    package.mkdir()
    lines = "from airrace.common.jit import compiled\n"
    (package / "constants.py").write_text("ONE = 1\n")
    # A package that exports what one of its files defines.
    exports = package / "exports"
    exports.mkdir()
    (exports / "__init__.py").write_text("from package.exports.zero import (\n    ZERO,\n)\n")
    (exports / "zero.py").write_text("ZERO = 0\n")
    imports = "from package.constants import ONE\nfrom package.exports import ZERO as NONE\n"
    inner = lines + imports + "@compiled\ndef f(x):\n    return x + ONE + NONE\n"
    (package / "inner.py").write_text(inner)
    (package / "outer.py").write_text(
        lines + "from package.inner import f\n@compiled\ndef g(x):\n    return f(x)\n"
    )
    (package / "other.py").write_text("pass\n")
    # Each run is a process of its own, which has imported what they have in common.
    program = """
import os, sys
from pathlib import Path
import numba
from airrace.common import jit

numba.njit(lambda x: x + 1)(1)
sys.dont_write_bytecode = True  # sources of one second and size would be the same to Python
for line in sys.stdin:
    if os.fork() == 0:
        sys.path.insert(0, line.strip())
        jit.PACKAGE = Path(line.strip()) / "package"
        numba.config.CACHE_DIR = str(jit.choose_folder(jit.PACKAGE))
        jit.remove_stale()
        from package.outer import g
        print(g(1), sum(g.stats.cache_hits.values()), flush=True)
        os._exit(0)
    if os.wait()[1]:
        sys.exit(1)
"""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    runs = subprocess.Popen([sys.executable, "-c", program], text=True, **pipes)

    def run(folder=tmp_path):
        print(folder, file=runs.stdin, flush=True)
        return tuple(runs.stdout.readline().split())

    assert run() == ("2", "0")
    assert run() == ("2", "1")
    # What is damaged, as after a loss of power, is made anew.
    for kind in ("nbi", "nbc"):
        for file in package.rglob(f"*.{kind}"):
            file.write_bytes(b"")
        assert run() == ("2", "0")
        assert run() == ("2", "1")
    # Neither the place nor the times of the files count.
    shutil.copytree(package, tmp_path / "elsewhere/package", copy_function=shutil.copy)
    assert run(tmp_path / "elsewhere") == ("2", "1")
    (package / "other.py").write_text("changed = True\n")
    assert run() == ("2", "1")
    (package / "inner.py").write_text(inner.replace("@", "\n\n@"))
    assert run() == ("2", "0")
    (package / "constants.py").write_text("ONE = 2\n")
    assert run() == ("3", "0")
    (exports / "zero.py").write_text("ZERO = 5\n")
    assert run() == ("8", "0")
    assert len(list((package / "__pycache__").glob("machine_code-*"))) == 1
    runs.communicate()
    assert runs.returncode == 0


@pytest.mark.slow
def test_importing_airrace_prints_nothing_deletes_nothing_and_compiles_nothing(tmp_path):
    old = jit.PACKAGE / "__pycache__" / "machine_code-of_a_test"
    old.mkdir(parents=True)
    program = """
import importlib, pkgutil, airrace
for module in pkgutil.walk_packages(airrace.__path__, "airrace."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
"""
    try:
        done = subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
        assert old.is_dir() and not list(tmp_path.rglob("*.nbc"))
    finally:
        old.rmdir()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where machine code is kept, empty."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "code"))
    return tmp_path / "code"


def test_it_is_complete_until_something_is_removed(folder):
    assert not jit.is_complete("truth")
    with jit.locked():
        kept = folder / "airrace.common" / "a-1.py312.1.nbc"
        kept.parent.mkdir()
        kept.touch()
        jit.set_complete("truth")
    assert jit.is_complete("truth") and not jit.is_complete("vio")
    kept.unlink()
    assert not jit.is_complete("truth")


def test_machine_code_of_another_processor_is_not_complete(folder, monkeypatch):
    jit.set_complete("truth")
    other = ("x86_64-unknown-linux-gnu", "another", "+avx512f")
    codegen = types.SimpleNamespace(magic_tuple=lambda: other)
    context = types.SimpleNamespace(codegen=lambda: codegen)
    monkeypatch.setattr(jit, "cpu_target", types.SimpleNamespace(target_context=context))
    assert not jit.is_complete("truth")


def test_where_nothing_can_be_kept_functions_are_compiled_all_the_same(folder):
    folder.write_text("no folder")
    kept = numba.njit(lambda x: x + 1)
    kept._cache = jit._Cache(all_finite.py_func)  # as that of a function of the package
    assert kept(1) == 2
    with pytest.raises(UserError, match=r"cannot be kept in .*set NUMBA_CACHE_DIR"), jit.locked():
        pass
    jit.set_complete("truth")
    assert not jit.is_complete("truth")


def test_what_is_compiled_is_counted_meanwhile():
    @numba.njit
    def one_more(x):
        return x + 1

    counts = []
    with jit.watched(counts.append):
        one_more(1)
        one_more(1)
        one_more(1.0)
    one_more(1j)
    assert counts == [1, 2]


def test_what_is_compiled_unasked_is_announced_once(monkeypatch, capsys):
    # Environments of other tests may have asked for it before.
    monkeypatch.setattr(numba.core.event, "_registered", collections.defaultdict(list))
    listeners = []
    with monkeypatch.context() as patch:
        patch.setattr(numba.core.event, "register", lambda *both: listeners.append(both))
        jit.announce()
    ((kind, listener),) = listeners

    @numba.njit
    def one_more(x):
        return x + 1

    with numba.core.event.install_listener(kind, listener):
        one_more(1)
        assert capsys.readouterr().err == ""  # it is no function of airrace's
        one_more.py_func.__module__ = "airrace.anything"
        one_more(1.0)
        one_more(1j)
    assert capsys.readouterr().err == "airrace: compiling, once; it takes about a minute\n"
