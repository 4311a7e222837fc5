"""What a companion computer needs for a race: an environment of the lock, and this airrace."""

import hashlib
import json
import queue
import tempfile
from pathlib import Path

from airrace.common.errors import UserError
from airrace.hitl.companion.set_up_display import SetUpDisplay
from airrace.hitl.companion.ssh import ConnectionLost, SshConnection
from airrace.hitl.companion.wheel import build_wheel, digest, source_digest

_HERE = Path(__file__).parent
_TOOLS = _HERE / "remote"
_ROOM = 1_500_000_000  # bytes; an environment takes 630 MB, its wheels 130 MB, at times twice
_START = (
    "import sys; sys.path.insert(0, sys.argv[1]); "
    "from remote.__main__ import main; sys.exit(main())"
)


class Deployment:
    """Where things are on a companion computer, once they are there.

    Attributes:
        cache: the folder there of everything that airrace keeps.
        environment, package: names below it; see airrace.hitl.companion.remote.set_up.
    """

    def __init__(
        self,
        connection: SshConnection,
        host: str,
        checkout: Path,
        wheels: Path | None,
        display: SetUpDisplay,
    ):
        """Brings over what is not there yet and has it installed.

        Args:
            connection: to the companion.
            host: what to call it.
            checkout: whose airrace and requirements.lock to bring.
            wheels: a folder of wheels to install from, instead of the index
                that pip is set to there; None: no.
            display: shows what is being done.

        Raises:
            UserError: if that fails.
            ConnectionLost: if the connection goes.
        """
        self._host = host
        display.step("looking for Python")
        self.cache, self._python = _find_python(connection, host)
        lock = checkout / "requirements.lock"
        self.environment, self.package = digest(lock), source_digest(checkout)
        self._tools = f"{self.cache}/tools/{digest(_TOOLS)}"
        connection.put({f"{self._tools}/remote/{path.name}": path for path in _TOOLS.glob("*.py")})
        [missing] = self._do(connection, {"do": "look"}, display)
        offline = missing["environment"] and wheels is not None
        if missing["environment"]:
            connection.put({f"{self.cache}/locks/{self.environment}.txt": lock})
        if offline:
            self._bring_wheels(connection, find_wheels(wheels, lock), display)
        if missing["package"]:
            display.step("building the wheel of this airrace")
            with tempfile.TemporaryDirectory(prefix="airrace-") as folder:
                wheel = build_wheel(checkout, Path(folder))
                connection.put({f"{self.cache}/wheels/{self.package}/{wheel.name}": wheel})
        self._do(connection, {"do": "set-up", "room": _ROOM, "offline": offline}, display)

    def _bring_wheels(self, connection, wheels, display):
        display.step("bringing the wheels")
        total = sum(wheel.stat().st_size for wheel in wheels)
        done = 0

        def progress(size):
            nonlocal done
            done += size
            display.progress(done, total)

        folder = f"{self.cache}/wheelhouse/{self.environment}"
        connection.put({f"{folder}/{wheel.name}": wheel for wheel in wheels}, progress)

    def _do(self, connection, job, display) -> list[dict]:
        """Does a job to its end and shows how far it is; returns its other events."""
        events, others, noise = queue.SimpleQueue(), [], []
        self.start(connection, job, events.put)
        while (event := events.get())["event"] != "done":
            match event["event"]:
                case "step":
                    display.step(event["text"])
                case "progress":
                    display.progress(event["done"], event["total"])
                case "noise":
                    noise.append(event["line"])
                case "missing":
                    others.append(event)
                case _:
                    raise self.failure(connection, event, noise)
        return others

    def start(self, connection: SshConnection, job: dict, on_event):
        """Starts a job; see airrace.hitl.companion.remote.__main__.

        Args:
            connection: to the companion.
            job: without ``cache``, ``environment`` and ``package``, unless it is ``stop``.
            on_event: called, in another thread, with every event; what it
                writes beside them is {"event": "noise", "line": ...}, and when
                there are no more, {"event": "end"}.

        Returns:
            a function that sends text to its standard input.
        """
        job = {"cache": self.cache, **job}
        if job["do"] != "stop":
            job |= {"environment": self.environment, "package": self.package}

        def on_line(line):
            on_event({"event": "end"} if line is None else _parse(line))

        return connection.start(
            [self._python, "-I", "-c", _START, self._tools], json.dumps(job) + "\n", on_line
        )

    def failure(self, connection: SshConnection, event: dict, noise: list[str]) -> Exception:
        """Returns the exception for an event that ends a job before it is done.

        Args:
            connection: that the job ran on.
            event: of the job.
            noise: lines that the job has written beside its events.
        """
        if event["event"] == "refused":
            return UserError(event["sentence"].format(host=self._host))
        if connection.lost:
            return ConnectionLost("it ended in the set-up")
        said = "\n".join(noise) or event["event"]
        return RuntimeError(f"airrace's program on {self._host} failed: {said}")


def _parse(line: str) -> dict:
    """Returns the event that a line is."""
    try:
        event = json.loads(line)
    except ValueError:
        event = None
    return event if isinstance(event, dict) else {"event": "noise", "line": line}


def find_wheels(folder: Path, lock: Path) -> list[Path]:
    """Returns the wheels of a folder that a lock has, by their hashes.

    Raises:
        UserError: if there are none.
    """
    text = lock.read_text(encoding="utf-8")
    try:
        wheels = [
            path
            for path in sorted(folder.glob("*.whl"))
            if hashlib.sha256(path.read_bytes()).hexdigest() in text
        ]
    except OSError as e:
        raise UserError(
            f"--wheels {folder} cannot be read ({e.strerror}); name another folder."
        ) from None
    if not wheels:
        raise UserError(
            f"--wheels {folder} holds no wheel of requirements.lock; fill it with "
            f"'python -m airrace.hitl.companion.arm_wheels --download {folder}'."
        )
    return wheels


def _find_python(connection, host) -> tuple[str, str]:
    """Returns airrace's cache folder and a suitable Python there."""
    script = (_HERE / "find_python.sh").read_text(encoding="utf-8")
    _, output, errors = connection.run(["sh", "-s"], script)
    found = dict(
        line.split(": ", 1)
        for line in output.splitlines()
        if line.startswith("airrace-") and ": " in line
    )
    if "airrace-cache" not in found:
        said = (output + errors).strip().splitlines()[-1:] or ["it says nothing"]
        raise UserError(
            f"{host} runs no commands over ssh ({said[0][:200]}); give the user a shell there."
        )
    if "airrace-python" not in found:
        uv = "" if "airrace-uv" in found else "install uv there (https://docs.astral.sh/uv) and "
        raise UserError(
            f"There is no Python 3.12, 3.13 or 3.14 with venv on {host}; {uv}run "
            "'uv python install 3.12' there."
        )
    machine = found.get("airrace-machine", "")
    if machine not in ("Linux aarch64", "Linux x86_64", "Linux arm64"):
        raise UserError(
            f"{host} is {machine or 'an unknown machine'}, for which Drake has no "
            "wheels; use one with 64-bit Linux."
        )
    return found["airrace-cache"], found["airrace-python"]
