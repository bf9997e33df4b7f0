"""Runs texelwalk for the experiment: finds the density, bakes, reads times and patches back.

In: the binary, a scene, options. Out: `Run` values. Bakes that are only references are kept and reused when binary,
input and options are the same; timed bakes never are.
"""

import hashlib
import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy

import environment
from coverage import coverage
from pictures import read_exr

# What the paper fixes, apart from the method itself: light is shot from the emitters, the walk is all there is.
PAPER_OPTIONS = ("--preset", "paper", "--direct", "shoot", "--gather", "0", "--alpha", "5", "--beta", "15")


@dataclass
class Run:
    """One bake: E/π per charted texel (patches × RGB), shares of a whole texel, and times [s]."""

    radiosity: numpy.ndarray
    share: numpy.ndarray
    walk_seconds: float
    wall_seconds: float
    baked: Path


def build_binary():
    """The release binary, built if needed."""
    done = subprocess.run(["cargo", "build", "--release", "--locked", "--bin", "texelwalk", "--message-format=json"],
                          cwd=environment.ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        environment.fail("cargo build --release failed")
    made = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    paths = [m["executable"] for m in made if m.get("executable")]
    if not paths:
        environment.fail("cargo built no binary")
    return Path(paths[-1])


def scene_file(name):
    for ending in ("glb", "gltf"):
        path = environment.ROOT / "fixtures" / name / f"{name}.{ending}"
        if path.is_file():
            return path
    environment.fail(f"fixtures/{name}/{name}.glb does not exist")


def bake(binary, scene, folder, name, options):
    """Bakes once; returns the report, the wall time [s] and the path of the result."""
    folder.mkdir(parents=True, exist_ok=True)
    output, report = folder / f"{name}.glb", folder / f"{name}.json"
    command = [str(binary), "bake", str(scene), "-o", str(output), "--report", str(report), "-q", *map(str, options)]
    started = time.perf_counter()
    done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
    wall = time.perf_counter() - started
    if done.returncode != 0:
        environment.fail(f"'{' '.join(command)}' ended with {done.returncode}: {done.stderr.strip()[-2000:]}")
    return json.loads(report.read_text(encoding="utf-8")), wall, output


def find_density(binary, scene, folder, patches, base):
    """Texels per metre that give about `patches` patches; their number goes with the square of the density."""
    density, best = 8.0, None
    for _ in range(8):
        report, _, _ = bake(binary, scene, folder, "density", (*base, "--lines", 1000, "--texels-per-meter", f"{density:.4f}"))
        found = report["atlas"]["texels"]
        if best is None or abs(found - patches) < abs(best[1] - patches):
            best = (density, found)
        if abs(found - patches) <= 0.02 * patches:
            break
        density *= (patches / max(found, 1)) ** 0.5
    if abs(best[1] - patches) > 0.1 * patches:
        environment.fail(f"{scene}: no density gives about {patches} patches; the nearest has {best[1]}")
    return best


def read_run(report, wall, baked):
    """Patches of all pages of a bake."""
    pages = sorted(baked.parent.glob(f"{baked.stem}.lightmap*.exr"), key=lambda p: int("".join(filter(str.isdigit, p.name.rsplit(".lightmap", 1)[1]))))
    if not pages:
        environment.fail(f"{baked}: no lightmap pages beside it")
    pixels = [read_exr(page) for page in pages]
    charted = [p[..., 3] > 0.5 for p in pixels]
    colors = [p[..., :3][c].astype(numpy.float64) for p, c in zip(pixels, charted)]
    shares = [s[c] for s, c in zip(coverage(baked, [c.shape for c in charted]), charted)]
    seconds = {s["name"]: s["seconds"] for s in report["stages"]}
    if "walk" not in seconds:
        environment.fail(f"the report has no stage called walk, only {sorted(seconds)}")
    return Run(numpy.concatenate(colors), numpy.concatenate(shares), seconds["walk"], wall, baked)


def reference(binary, scene, folder, name, options):
    """A bake whose result is kept from call to call."""
    key = hashlib.sha256(binary.read_bytes() + scene.read_bytes() + repr(options).encode()).hexdigest()
    stamp, output, report = folder / f"{name}.key", folder / f"{name}.glb", folder / f"{name}.json"
    if stamp.is_file() and stamp.read_text(encoding="utf-8") == key and output.is_file():
        return read_run(json.loads(report.read_text(encoding="utf-8")), 0.0, output)
    sys.stderr.write(f"reference {name}\n")
    run = read_run(*bake(binary, scene, folder, name, options))
    stamp.write_text(key, encoding="utf-8")
    return run
