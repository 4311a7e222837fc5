"""What broken and hostile files and messages do to who reads them: a sentence at most.

    python -m benchmarks.robustness [--inputs 200] [--only race.json league.json] [--json FILE]

Each input is a sound file, or what comes over a socket, in which bits, bytes or values were
changed, deleted or repeated. A crash is any exception but the one that becomes a sentence, or more
than 1 GB of memory; a hang takes more than 10 s of processor time, or a minute; a wrong result is
one that the input does not say, without a word, or a socket that takes nothing sound any more. Of
kinds whose reading takes about a second, a fifth of the inputs is tried.
"""

import contextlib
import io
import resource
import signal
import sys
import tempfile
import traceback
from pathlib import Path
from random import Random

from benchmarks import harness
from tests.worlds.untrusted_files import FILES
from tests.worlds.untrusted_kind import WrongResult, try_input
from tests.worlds.untrusted_messages import MESSAGES

KINDS = (*FILES, *MESSAGES)

_LONGEST, _MEMORY = 10.0, 1e9  # s of processor time, bytes
_LONGEST_WALL = 60.0  # s, on a busy computer
_TITLE = "Mutated files and messages (bounds: no crash, no hang, no wrong result)"


class _Hang(BaseException):
    """An input takes too long."""


def main(argv=None) -> int:
    """Tries the inputs and prints the table; exit code 1 if one does harm."""
    parser = harness.make_parser(__doc__)
    names = [kind.name for kind in KINDS]
    parser.add_argument("--inputs", type=harness.count, default=200, help="default: %(default)s")
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="kinds to try")
    return harness.run(parser, argv, measure, show)


def measure(args) -> list:
    """Returns a row for every kind."""
    jobs = [(try_kind, (name, args.inputs)) for name in args.only]
    return harness.in_processes(jobs, "Reading", workers=2, jobs_each=len(jobs))


def try_kind(name: str, inputs: int) -> dict:
    """Returns how many of a kind's inputs did which harm, and the first of each."""
    (kind,) = (each for each in KINDS if each.name == name)
    inputs = max(1, inputs // 5) if kind.slow else inputs
    row = {"kind": name, "inputs": inputs, "crashes": 0, "hangs": 0, "wrong": 0, "first": None}
    for number in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(number, _raise_hang)
    with tempfile.TemporaryDirectory() as folder:
        path = kind.make(Path(folder))
        whole = path.read_bytes()
        with contextlib.redirect_stderr(io.StringIO()):
            kind.read(path)  # what is sound is read
        before = _memory()
        for seed in range(inputs):
            harm = _harm(kind, path, kind.mutate(Random(f"{name} {seed}"), whole))
            if harm is None and _memory() - before > _MEMORY:
                harm, before = ("crashes", "more than 1 GB"), _memory()
            if harm is not None:
                row[harm[0]] += 1
                row["first"] = row["first"] or f"input {seed}: {harm[1]}"
    return row


def _harm(kind, path, data):
    """Returns which harm an input does, and what is said of it; None if none."""
    signal.setitimer(signal.ITIMER_PROF, _LONGEST)
    signal.setitimer(signal.ITIMER_REAL, _LONGEST_WALL)
    try:
        try_input(kind, path, data)
    except _Hang:
        return "hangs", "it takes too long"
    except WrongResult as e:
        return "wrong", str(e)
    except Exception as e:
        at = traceback.extract_tb(e.__traceback__)[-1]
        return (
            "crashes",
            f"{type(e).__name__}: {str(e)[:200]} ({Path(at.filename).name}:{at.lineno})",
        )
    finally:
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0.0)
    return None


def _raise_hang(*_):
    raise _Hang


def _memory():
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def show(rows: list) -> tuple[list, bool]:
    """Returns the table of the rows, and whether no input did harm."""
    columns = {
        "kind": "{kind}",
        "inputs tried": "{inputs}",
        "crashes": "{crashes}",
        "hangs": "{hangs}",
        "wrong results": "{wrong}",
    }
    found = [f"{row['kind']}: {row['first']}" for row in rows if row["first"]]
    return [harness.make_table(_TITLE, rows, columns), *found], not found


if __name__ == "__main__":
    sys.exit(main())
