"""Shows glTF files on the page of pipelines/web, in headless Chromium.

In: jobs as browser.mjs takes them, addresses made by `address_of` and `local_page`. Out: what the page hands over, one
result a job. The repository is served on a free port of this machine for as long as that takes. Chromium is the command
`chromium`.
"""

import contextlib
import functools
import http.server
import json
import shutil
import subprocess
import sys
import threading
import time
import urllib.parse
from pathlib import Path

import environment

sys.path.insert(0, str(environment.ROOT / "pipelines" / "web"))

import build  # noqa: E402 (found through the path above)

NAMES = ("chromium", "chromium-browser", "google-chrome")
TIMEOUT_SECONDS = 400
# Last digits of pages in the order in which the browser gets them, so far apart: what a page shows must not depend on it.
ARRIVAL = "03142"
PAGE_DELAY_SECONDS = 0.15


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files, lightmap pages in an order of our own, and says nothing about it."""

    def do_GET(self):
        if self.path.endswith(".exr"):
            time.sleep(PAGE_DELAY_SECONDS * (1 + ARRIVAL.find(self.path[-5])))
        super().do_GET()

    def log_message(self, *arguments):
        pass


@contextlib.contextmanager
def served(folder):
    """Serves a folder; gives its address."""
    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def address_of(file):
    """Address of the page that shows a file of the repository, relative to where it is served."""
    try:
        inside = Path(file).resolve(strict=True).relative_to(environment.ROOT)
    except FileNotFoundError:
        environment.fail(f"{file}: no such file")
    except ValueError:
        environment.fail(f"{file}: lies outside {environment.ROOT}, which is what the browser sees; copy it there")
    return f"/target/web/index.html?file={urllib.parse.quote('/' + inside.as_posix(), safe='')}"


def local_page():
    """Address of the page on the disk, to pick files on: no server takes part."""
    return (build.PAGE / "index.html").as_uri()


def chromium():
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if not found:
        environment.fail("Chromium is not installed; on Debian: apt-get install chromium")
    return found


def shown(jobs):
    """Runs jobs one after the other in one browser."""
    browser = chromium()
    _, node = build.build(tests=True)
    script = Path(__file__).with_name("browser.mjs")
    with served(environment.ROOT) as start:
        placed = [job | {"address": urllib.parse.urljoin(start, job["address"])} for job in jobs]
        order = {"modules": str(build.PACKAGES / "node_modules"), "chromium": browser, "jobs": placed}
        try:
            done = subprocess.run([str(node), str(script)], input=json.dumps(order), capture_output=True, text=True,
                                  timeout=TIMEOUT_SECONDS, check=False)
        except subprocess.TimeoutExpired:
            environment.fail(f"Chromium did not finish within {TIMEOUT_SECONDS} s")
    if done.returncode != 0:
        environment.fail(f"the browser did not run: {done.stderr.strip()[-3000:]}")
    return json.loads(done.stdout)
