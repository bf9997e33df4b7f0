"""Makes the environment of the studies: Embree and Mitsuba, apart from Blender's because their versions of NumPy differ.

In: requirements.txt. Out: target/study/venv in the repository, made anew when its requirements have changed.
Two studies that start together do not install over each other: a lock file serialises them.
"""

import contextlib
import fcntl
import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
WORK = ROOT / "target" / "study"
VENV = WORK / "venv"
REQUIREMENTS = HERE / "requirements.txt"


def fail(message):
    sys.stderr.write(f"error: {message}\n")
    raise SystemExit(1)


def run(what, command, **kwargs):
    """Standard output of a command that has to succeed."""
    try:
        done = subprocess.run([str(c) for c in command], stdout=subprocess.PIPE, text=True, check=False, **kwargs)
    except FileNotFoundError:
        fail(f"{what}: '{command[0]}' is not installed")
    if done.returncode != 0:
        fail(f"{what} failed with exit code {done.returncode}")
    return done.stdout


@contextlib.contextmanager
def locked(name):
    WORK.mkdir(parents=True, exist_ok=True)
    with open(WORK / name, "w", encoding="utf-8") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def python():
    """The environment's Python; makes the environment if needed."""
    stamp, program = VENV / "stamp", VENV / "bin" / "python"
    wanted = hashlib.sha256(REQUIREMENTS.read_bytes()).hexdigest()
    with locked("venv.lock"):
        if not (stamp.is_file() and stamp.read_text(encoding="utf-8") == wanted):
            shutil.rmtree(VENV, ignore_errors=True)
            sys.stderr.write("making the Python environment of the studies (about 500 MB, once)\n")
            run("making the environment", [sys.executable, "-m", "venv", VENV])
            run("installing Embree and Mitsuba", [program, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
                                                  "--only-binary=:all:", "-r", REQUIREMENTS])
            stamp.write_text(wanted, encoding="utf-8")
    return program
