import subprocess
import sys

from airrace.common.processes import child_environment


def test_a_child_elsewhere_imports_what_this_process_does(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "only_here.py").write_text("ANSWER = 42\n")
    monkeypatch.chdir(tmp_path / "mine")
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    monkeypatch.setenv("AIRRACE_TEST", "kept")
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "import airrace, only_here, os; print(only_here.ANSWER, os.environ['AIRRACE_TEST'])",
        ],
        cwd=tmp_path,
        env=child_environment(),
        capture_output=True,
        text=True,
    )
    assert done.stdout == "42 kept\n", done.stderr
