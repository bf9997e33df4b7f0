"""Makes the environment of the studies: Embree and Mitsuba, apart from Blender's because their versions of NumPy differ.

In: requirements.txt. Out: target/study/venv in the repository, made anew when its requirements have changed.
Two studies that start together do not install over each other: a lock file serialises them.
"""

import hashlib
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(1, str(HERE.parent / "checks"))

from environment import ROOT, locked, run  # noqa: E402 (its folder comes first)

WORK = ROOT / "target" / "study"
VENV = WORK / "venv"
REQUIREMENTS = HERE / "requirements.txt"


def python():
    """The environment's Python; makes the environment if needed."""
    stamp, program = VENV / "stamp", VENV / "bin" / "python"
    wanted = hashlib.sha256(REQUIREMENTS.read_bytes()).hexdigest()
    with locked(WORK / "venv.lock"):
        if not (stamp.is_file() and stamp.read_text(encoding="utf-8") == wanted):
            shutil.rmtree(VENV, ignore_errors=True)
            sys.stderr.write("making the Python environment of the studies (about 500 MB, once)\n")
            run("making the environment", [sys.executable, "-m", "venv", VENV])
            run("installing Embree and Mitsuba", [program, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
                                                  "--only-binary=:all:", "-r", REQUIREMENTS])
            stamp.write_text(wanted, encoding="utf-8")
    return program
