"""Bakes files as optimisers leave them, and compares what was read with what the formats' reference decoders read.

    python3 pipelines/checks/compressed.py PROGRAM OUT_DIR FILE... [--how NAME...] [--options="--sky 1,1,1"]

In: the texelwalk program, and glTF files. Each is compressed by gltfpack and by glTF-Transform (HOWS), baked, and then
* every corner of every triangle of the compressed file is in the baked one, bit for bit, as glTF-Transform reads both with
  the decoders of meshoptimizer and of Google's Draco;
* nothing else of it is lost (`preserved.py`);
* the Khronos validator finds nothing;
* the light is that of the plain file: the power that surfaces take up differs by at most POWER.
Out: exit code 0; 1 and what is wrong.

Why power and not texels: quantised triangles have other charts.
"""

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import environment

# gltfpack keeps nodes and materials apart, so that a node's triangles can be found again.
KEEP = ["-kn", "-km", "-ke"]
GLTFPACK = {
    "gltfpack": KEEP,
    "gltfpack -c": ["-c", *KEEP],
    "gltfpack -cc": ["-cc", *KEEP],
    "gltfpack -cc, KHR": ["-cc", "-ce", "khr", *KEEP],
    "gltfpack -cf": ["-c", "-cf", *KEEP],
    "gltfpack -noq": ["-noq", *KEEP],
    # Kept nodes would have no instances.
    "gltfpack -mi": ["-mi", "-km", "-ke"],
}
TRANSFORM = ["draco", "draco-sequential", "meshopt", "quantize", "weld", "join", "instance", "webp"]
HOWS = [*GLTFPACK, *TRANSFORM]
# glTF-Transform does not know the younger name of the same extension; then only validity and light are compared.
UNREADABLE = {"gltfpack -cc, KHR"}
# Relative; 14 bits for positions, 8 for normals, at 4 texels per metre.
POWER = 0.02
BAKE = ["--preset", "preview", "--texels-per-meter", "4", "--gather", "0", "-q"]


def node(*arguments):
    binary, _ = environment.node()
    return subprocess.run([str(binary), *map(str, arguments)], cwd=environment.NODE, capture_output=True, text=True, check=False)


def make(source, target, how):
    """Compresses a file; a sentence if that failed."""
    if how in GLTFPACK:
        pack = lambda options: node("node_modules/gltfpack/cli.js", "-i", source, "-o", target, *options)
        done = pack(GLTFPACK[how])
        if done.returncode == 0 and not is_json(target):
            # It writes extras that are a text without quotes.
            done = pack([option for option in GLTFPACK[how] if option != "-ke"])
    else:
        done = node(Path(__file__).with_name("compress.mjs"), "make", source, target, how)
    return None if done.returncode == 0 and target.is_file() else f"{how} failed: {done.stdout}{done.stderr}"


def is_json(glb):
    """The JSON chunk of a GLB can be read."""
    data = glb.read_bytes()
    try:
        json.loads(data[20:20 + int.from_bytes(data[12:16], "little")])
    except ValueError:
        return False
    return True


def bake(program, source, target, options):
    """Bakes a file; (error or None, power that surfaces take up [lm])."""
    target.parent.mkdir(parents=True, exist_ok=True)
    report = target.with_suffix(".json")
    done = subprocess.run([program, "bake", source, "-o", target, "--report", report, *BAKE, *options],
                          capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return f"exit code {done.returncode}: {done.stderr.strip()}", 0.0
    return None, sum(json.loads(report.read_text(encoding="utf-8"))["walk"]["power_absorbed"])


def faults(program, source, how, folder, options, plain):
    name = "".join(c if c.isalnum() else "-" for c in how)
    packed = folder / name / f"{source.stem}.glb"
    packed.parent.mkdir(parents=True, exist_ok=True)
    why = make(source, packed, how)
    if why:
        return [why]
    baked = folder / name / "baked" / packed.name
    why, power = bake(program, packed, baked, options)
    if why:
        return [why]
    found = []
    if not abs(power - plain) <= POWER * plain:
        found.append(f"surfaces take up {power:.6g} lm, and {plain:.6g} lm of the plain file")
    if how not in UNREADABLE:
        done = node(Path(__file__).with_name("compress.mjs"), "same", packed, baked)
        if done.returncode != 0:
            found.append(done.stderr.strip())
    valid = subprocess.run([sys.executable, Path(__file__).with_name("validate.py"), "--input", packed, baked],
                           capture_output=True, text=True, check=False)
    if valid.returncode != 0:
        found.append(valid.stdout[-2000:] + valid.stderr[-2000:])
    kept = subprocess.run([sys.executable, Path(__file__).with_name("preserved.py"), "--compressed", packed, baked],
                          capture_output=True, text=True, check=False)
    if kept.returncode != 0:
        found.append(kept.stdout[:2000] + kept.stderr[-500:])
    if not found:
        print(f"{source.stem}, {how}: {packed.stat().st_size} bytes, power {power / plain:.5f} of the plain file's")
    return found


def main():
    environment.enter()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=Path)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--how", choices=HOWS, nargs="+", default=HOWS)
    parser.add_argument("--options", default="", help="of the bake, in one word")
    arguments = parser.parse_args()
    options = arguments.options.split()
    bad = 0
    for source in arguments.files:
        folder = arguments.folder.resolve() / source.stem
        why, plain = bake(arguments.program, source.resolve(), folder / "plain" / f"{source.stem}.glb", options)
        if why:
            print(f"error: {source}: {why}", file=sys.stderr)
            return 1
        one = lambda how: faults(arguments.program, source.resolve(), how, folder, options, plain)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for how, found in zip(arguments.how, pool.map(one, arguments.how)):
                bad += len(found)
                for fault in found:
                    print(f"error: {source.stem}, {how}: {fault}", file=sys.stderr)
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
