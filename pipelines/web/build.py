"""Builds the page that shows baked glTF files in a browser: target/web/index.html and main.js.

In: package.json and package-lock.json (exact versions), the sources beside this file. Out: target/web, static files that
open from any server or from the disk; the path of the page on stdout. Packages go to target/web-node.

Uses Node.js and npm of the PATH if Node.js is 20 or newer, else those of the environment of the cross-checks, which is
then made. Idempotent: a stamp tells whether the packages are those of the lock file. `--tests` also installs what
pipelines/checks/browser.py needs. Uses the standard library only.
"""

import argparse
import hashlib
import re
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT / "pipelines" / "checks"))

import environment  # noqa: E402 (found through the path above)

PACKAGES = ROOT / "target" / "web-node"
PAGE = ROOT / "target" / "web"
LOCK = ROOT / "target" / "web.lock"
LEAST_NODE = 20
ESBUILD = ("--bundle", "--minify", "--format=iife", "--target=es2022", "--legal-comments=eof", "--log-level=warning")


def system_node():
    """node and npm of the PATH as commands, if new enough; else None."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if not node or not npm:
        return None
    said = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout
    version = re.match(r"v(\d+)\.", said)
    return (node, [npm]) if version and int(version[1]) >= LEAST_NODE else None


def tools():
    """The command for node, and the one for npm."""
    found = system_node()
    if found:
        return found
    environment.ensure()
    node, npm = environment.node()
    return str(node), [str(node), str(npm)]


def install(tests):
    """Makes target/web-node hold the packages of the lock file; returns node."""
    node, npm = tools()
    names = ("package.json", "package-lock.json")
    wanted = hashlib.sha256(b"".join((HERE / name).read_bytes() for name in names)).hexdigest()
    stamp = PACKAGES / "stamp"
    have = stamp.read_text(encoding="utf-8").split() if stamp.is_file() else []
    if wanted in have and ("tests" in have or not tests):
        return node
    shutil.rmtree(PACKAGES, ignore_errors=True)
    PACKAGES.mkdir(parents=True)
    for name in names:
        shutil.copy(HERE / name, PACKAGES / name)
    omit = [] if tests else ["--omit=dev"]
    environment.run("installing the packages of the page",
                    [*npm, "ci", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", PACKAGES, *omit],
                    "Is a package index reachable?")
    stamp.write_text(f"{wanted} {'tests' if tests else 'page'}\n", encoding="utf-8")
    return node


def bundle(node):
    PAGE.mkdir(parents=True, exist_ok=True)
    # esbuild looks for packages in the folders above a file; the sources have none.
    command = [node, PACKAGES / "node_modules" / "esbuild" / "bin" / "esbuild", HERE / "main.js", *ESBUILD,
               f"--outfile={PAGE / 'main.js'}"]
    environment.run("bundling the page", command, env={"NODE_PATH": str(PACKAGES / "node_modules")})
    shutil.copy(HERE / "index.html", PAGE / "index.html")


def build(tests=False):
    """Installs and bundles; returns the page and node."""
    with environment.locked(LOCK):
        node = install(tests)
        bundle(node)
    return PAGE / "index.html", node


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tests", action="store_true", help="install what the browser check needs, too")
    page, _ = build(parser.parse_args().tests)
    print(page)


if __name__ == "__main__":
    main()
