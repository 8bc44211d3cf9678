"""Build the sdist and the wheel, install the wheel beside the core dependencies alone, and use it.

The environment `.venv-wheel` has no extras, so an import of a development package that slipped into the
package's core fails here. It is kept between runs, and made anew when the pins or `pyproject.toml` change.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv-wheel"
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")
DIST = ROOT / "dist"
INPUTS = [ROOT / "constraints-core.txt", ROOT / "pyproject.toml"]


def run(*command: str | Path, cwd: Path = ROOT) -> str:
    """Run a command, show it, and end with its output where it fails."""
    shown = " ".join([Path(command[0]).name, *map(str, command[1:])]).replace(f"{ROOT}{os.sep}", "")
    print("  $", shown, flush=True)
    # A bare user's environment: nothing of the source tree on the path.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if done.returncode:
        sys.exit(f"{done.stdout}\nThe wheel test failed: `{shown}` exited with {done.returncode}.")
    return done.stdout


def make_environment() -> None:
    """Make .venv-wheel with the pinned core dependencies, unless it is there and up to date."""
    stamp = VENV / ".installed"
    wanted = hashlib.sha256(b"".join(path.read_bytes() for path in INPUTS)).hexdigest()
    if stamp.exists() and stamp.read_text() == wanted:
        return
    venv.create(VENV, clear=True, with_pip=True)
    run(BIN / "python", "-m", "pip", "install", "-qq", "--require-hashes", "-r", "constraints-core.txt")
    stamp.write_text(wanted)


def main() -> None:
    shutil.rmtree(DIST, ignore_errors=True)
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", DIST)
    (wheel,) = DIST.glob("*.whl")

    make_environment()
    run(BIN / "python", "-m", "pip", "install", "-qq", "--no-deps", "--force-reinstall", wheel)
    run(BIN / "python", "-m", "pip", "check")

    with tempfile.TemporaryDirectory() as name:
        empty = Path(name)
        run(BIN / "python", "-W", "error", "-c", "import lithoform", cwd=empty)
        run(BIN / "lithoform", "--help", cwd=empty)
        run(BIN / "lithoform", *"generate out --count 1 --seed 7 --triangles 5000".split(), cwd=empty)
        run(BIN / "lithoform", "check", Path("out", "000001.stl"), cwd=empty)
    print(f"  {wheel.name} works in a bare environment")


if __name__ == "__main__":
    main()
