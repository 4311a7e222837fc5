"""A checkout whose autonomy is a few lines long, and a lock of one tiny wheel."""

import base64
import hashlib
import shutil
import zipfile
from pathlib import Path

from airrace.hitl.companion.set_up import LOCK

ROOT = Path(__file__).resolve().parents[3]

AUTONOMY = '''
"""Stands in for the autonomy: does what its arguments say."""
import os, signal, subprocess, sys, time
from pathlib import Path

assert sys.argv[1:2] == ["autonomy"]
words = sys.argv[2:]
print("arguments", words)
print("folder", sorted(os.listdir()), file=sys.stderr)
output = Path("output")
(output / "map").mkdir()
(output / "map" / "map.json").write_text("[1]")
if "stubborn" in words:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
else:
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
if "worker" in words:
    worker = subprocess.Popen(["sleep", "1000"])
    (output / "worker").write_text(str(worker.pid))
print("airrace: autonomy ready")
if "module" in words:
    sys.path.append(os.getcwd())  # as for systems that a scenario names
    import my_team
    print(my_team.WORD)
if "farewell" in words:
    sys.exit(0)
if "die" in words:
    os.kill(os.getpid(), signal.SIGKILL)
for i in range(6000):
    time.sleep(0.02)
    if "talk" in words:
        print("line", i)
    if os.path.exists("output/silence"):
        sys.exit(3)
'''


def make_wheel(
    folder: Path, name: str, version: str, files: dict[str, str], tag: str = "py3-none-any"
) -> Path:
    """Makes a wheel of some files, and returns it."""
    info = f"{name}-{version}.dist-info"
    files = {
        **files,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\n"
        f"Tag: {tag}\n",
    }
    record = "".join(f"{path},sha256={_digest(text)},{len(text)}\n" for path, text in files.items())
    files[f"{info}/RECORD"] = f"{record}{info}/RECORD,,\n"
    wheel = folder / f"{name}-{version}-{tag}.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for path, text in files.items():
            archive.writestr(zipfile.ZipInfo(path), text)
    return wheel


def _digest(text):
    digest = hashlib.sha256(text.encode()).digest()
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode()


def make_lock(path: Path, wheels: list[Path]) -> None:
    """Writes a lock of some wheels."""
    lines = []
    for wheel in wheels:
        name, version = wheel.name.split("-")[:2]
        digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
        lines.append(f"{name}=={version} \\\n    --hash=sha256:{digest}\n")
    path.write_text("".join(lines))


def make_checkout(folder: Path, drake: str = "") -> tuple[Path, Path]:
    """Makes the checkout, and a folder with the wheel of its lock; returns both.

    Args: folder: for both. drake: source of pydrake.common.
    """
    checkout, wheels = folder / "checkout", folder / "wheels"
    wheels.mkdir(parents=True)
    wheel = make_wheel(
        wheels, "drake", "1.58.0", {"pydrake/__init__.py": "", "pydrake/common.py": drake}
    )
    (checkout / "airrace" / "hitl").mkdir(parents=True)
    (checkout / "models").mkdir()
    for name in ("pyproject.toml", "models/package.xml"):
        shutil.copy(ROOT / name, checkout / name)
    (checkout / "airrace" / "__init__.py").touch()
    (checkout / "airrace" / "hitl" / "__main__.py").write_text(AUTONOMY)
    make_lock(checkout / LOCK, [wheel])
    return checkout, wheels
