"""Bakes a folder of glTF files by anyone, and judges every result: no panic, no hang, no invalid output.

In: FOLDER with the files, LIST (one file a line: path below FOLDER, repository, commit, separated by tabs), OUT, a folder
for what is baked; `--program` names the texelwalk to try. Out: OUT/results.jsonl, one object a file (files that stand in it
are not run again, so an interrupted run goes on), and the table results.md beside this script or where `--table` says. Exit
code 1 if there is a fault.

For each file: `inspect` tells the area of its surfaces, from which a density of about 20,000 texels follows; `bake --preset
preview --sky 0.4,0.5,0.7` on one page, two threads, at most 120 s of processor time (60 s of a machine that does nothing
else) and 6 GiB of address space. What it answers is
* baked (0), then the Khronos validator may find no error or warning in the output whose code it does not find in the input,
  `preserved.py` may find nothing lost, and `check` no fault in coordinates, page files or values; or
* refused (3, or 4 for files that cannot be read; 1 where more charts than fit on the page are needed) with one line that
  says why; or
* a fault: any other exit code, `panicked` on stderr, a signal, more time.
Whether a refusal is right is for people to judge: the table says what the validator thinks of each refused file.

A file whose own faults keep a judge from reading it (the validator or `preserved.py` gives up) is told so in the table.
"""

import argparse
import json
import re
import resource
import shutil
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[1:1] = [str(HERE.parent / "checks")]

import environment  # noqa: E402

environment.enter()

import numpy  # noqa: E402 (the environment comes first)
from gltf_file import GltfError, GltfFile  # noqa: E402
from preserved import Comparison  # noqa: E402
from validate import messages, reports  # noqa: E402

TEXELS, PROCESSOR_SECONDS, ADDRESS_SPACE_BYTES = 20_000, 120, 6 << 30
# Ends what waits for something.
LONGEST_SECONDS = 1200
# What `check` may never find in a bake of ours. Its other measures say how good the density is for a scene, which here is
# that of about TEXELS texels for anything, a car with its bolts as well as a box; the table counts them.
NEVER = ("page", "values", "uv-missing", "uv-range", "uv-overlap", "uv-degenerate")
REFUSED = (3, 4)
FULL = "do not fit on"
# KHR_materials_pbrSpecularGlossiness, long deprecated, wants to be the only extension of a material.
UNAVOIDABLE = {"MULTIPLE_EXTENSIONS"}
# What is baked is written without these, and preserved.py cannot compare with what it cannot read.
COMPRESSIONS = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"}


def limit():
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE_BYTES, ADDRESS_SPACE_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_SECONDS, PROCESSOR_SECONDS))


def run(command):
    """Exit code (None: it waits for ever; negative: a signal), stdout, stderr, seconds."""
    start = time.monotonic()
    try:
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True, errors="replace", check=False,
                              stdin=subprocess.DEVNULL, timeout=LONGEST_SECONDS, preexec_fn=limit)
    except subprocess.TimeoutExpired as slow:
        said = (slow.stderr or b"").decode(errors="replace")
        return None, "", said, time.monotonic() - start
    return done.returncode, done.stdout, done.stderr, time.monotonic() - start


def density(program, file):
    """Texels per metre for about TEXELS texels; 1 where the file cannot be inspected."""
    code, out, said, seconds = run([program, "inspect", file, "--json", "--texels-per-meter", "0.001"])
    area = sum(part["area"] for part in json.loads(out)["parts"]) if code == 0 else 0
    return (code, said, seconds), f"{(TEXELS / area) ** 0.5:.4g}" if area > 0 else "1"


def validated(files):
    """Codes of errors and warnings per file, or None where the validator gives up."""
    try:
        found = reports(files)
    except (SystemExit, json.JSONDecodeError):
        return None
    return [sorted({m["code"] for m in messages(r, 0) + messages(r, 1)}) for r in found]


def lost(file, baked):
    """What preserved.py misses in the output, and why it cannot tell."""
    try:
        before = GltfFile(file)
        packed = set(before.json.get("extensionsUsed", [])) & COMPRESSIONS
        if packed:
            return [], f"it does not read {', '.join(sorted(packed))}"
        with numpy.errstate(all="ignore"):
            return Comparison(before, GltfFile(baked)).run(), ""
    except (GltfError, OSError) as error:
        return [], str(error)
    except Exception as error:  # noqa: BLE001 (it expects well-formed files; those here need not be)
        return [], f"{type(error).__name__}: {error}"


def judge_output(program, file, baked, row):
    validator = validated([file, baked])
    if validator is None:
        row["unjudged"].append("validator")
    else:
        row["validator"] = validator[0]
        row["faults"] += [f"validator: {code}" for code in validator[1] if code not in {*validator[0], *UNAVOIDABLE}]
    gone, unreadable = lost(file, baked)
    row["faults"] += [f"preserved: {fault}" for fault in gone[:3]]
    if unreadable:
        row["unjudged"].append(f"preserved ({unreadable[:100]})")
    if row["texels"] == 0:
        # Nothing but skinned, morphed or unlit meshes: the output has no pages, and `check` says so.
        return
    code, out, said, _ = run([program, "check", baked, "--json", "-"])
    if code != 0:
        row["faults"].append(f"check: exit code {code}: {said.strip()[-200:]}")
        return
    found = json.loads(out)["faults"]
    row["faults"] += [f"check: {name}" for name in found if name in NEVER]
    row["check"] = [name for name in found if name not in NEVER]


def bake(program, file, out):
    """One row of the table."""
    (code, said, seconds), texels_per_meter = density(program, file)
    row = {"density": texels_per_meter, "faults": [], "unjudged": [], "warnings": []}
    if code is None or code not in (0, *REFUSED) or "panicked" in said:
        row["faults"].append(f"inspect: exit code {code}: {said.strip()[-200:]}")
    shutil.rmtree(out, ignore_errors=True)
    report = out.with_suffix(".json")
    command = [program, "bake", file, "-o", f"{out}/", "--preset", "preview", "--sky", "0.4,0.5,0.7", "--threads", "2",
               "--texels-per-meter", texels_per_meter, "--max-pages", "1", "--report", report]
    report.unlink(missing_ok=True)
    code, _, said, row["seconds"] = run(command)
    row["exit"] = code
    errors = [line for line in said.splitlines() if line.startswith("error: ")]
    row["said"] = errors[-1][len("error: "):] if errors else ""
    if "panicked" in said:
        row["faults"].append("panic: " + next(line for line in said.splitlines() if "panicked" in line))
    if code == 0:
        told = json.loads(report.read_text(encoding="utf-8"))
        row["triangles"], row["texels"] = told["scene"]["triangles"], told["atlas"]["texels"]
        row["warnings"] = sorted({w["code"] for w in told["warnings"]})
        row["extensions"] = re.findall(r"\b(?:KHR|EXT|MSFT|ADOBE|AGI|CESIUM|MOZ|FB|NV)_\w+", " ".join(w["message"] for w in told["warnings"]))
        judge_output(program, file, out / file.name, row)
    elif (code in REFUSED or code == 1 and FULL in said) and len(errors) == 1:
        found = validated([file])
        row["validator"] = found[0] if found else ["unreadable"]
        if out.exists():
            row["faults"].append("refused, but something was written")
    else:
        row["faults"].append(f"exit code {code} after {row['seconds']:.0f} s: {said.strip()[-200:]}")
    return row


def outcome(row):
    if row["faults"]:
        return "**fault**"
    return "baked" if row["exit"] == 0 else "refused"


def cell(text):
    return re.sub(r"\s+", " ", str(text)).replace("|", "\\|")


def table(rows, version):
    """The results as Markdown."""
    counts = Counter(outcome(row) for row in rows)
    sources = sorted({(row["repository"], row["commit"]) for row in rows})
    slowest = max((row["seconds"] for row in rows), default=0)
    lines = ["# What becomes of glTF files by others", "", "Made by `run.py` (see there for what is judged and how).", "",
             f"{len(rows)} files by {version}: {counts['baked']} baked, {counts['refused']} refused, "
             f"{counts['**fault**']} with a fault. The slowest bake took {slowest:.0f} s (two threads of a busy machine).", ""]
    quality = Counter(name for row in rows for name in row.get("check", []))
    lines += ["Baked files with other measures of `check` above their limits, at this density: "
              + ", ".join(f"{name} {count}" for name, count in sorted(quality.items())) + ".", ""]
    lines += [f"* {name} @ {commit}: {sum(row['repository'] == name for row in rows)}" for name, commit in sources]
    lines += ["", "| file | bytes | triangles | texels | s | outcome | warnings, or why it was refused (and what the validator finds) |",
              "|---|---|---|---|---|---|---|"]
    for row in rows:
        if row["faults"]:
            why = "; ".join(row["faults"])
        elif row["exit"] == 0:
            why = ", ".join(row["warnings"]) + "".join(f" (not judged: {u})" for u in row["unjudged"])
        else:
            said = row["said"].split(f"{row['path']}: ")[-1]
            why = f"{said} ({', '.join(row['validator']) or 'no fault'})"
        name = f"{row['repository'].split('/')[-1]}: {row['name']}"
        lines.append(f"| {cell(name)} | {row['bytes']:,} | {row.get('triangles', '')} | {row.get('texels', '')} | "
                     f"{row['seconds']:.1f} | {outcome(row)} | {cell(why)} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("list", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--program", type=Path, default=HERE.parents[1] / "target" / "release" / "texelwalk")
    parser.add_argument("--table", type=Path, default=HERE / "results.md")
    arguments = parser.parse_args()
    arguments.program = arguments.program.resolve()
    arguments.out.mkdir(parents=True, exist_ok=True)
    log = arguments.out / "results.jsonl"
    rows = {}
    if log.exists():
        rows = {row["path"]: row for row in map(json.loads, log.read_text(encoding="utf-8").splitlines())}
    wanted = [line.split("\t")[:3] for line in arguments.list.read_text(encoding="utf-8").splitlines() if line.strip()]
    for number, (path, repository, commit) in enumerate(wanted):
        if path in rows:
            continue
        file = arguments.folder / path
        row = bake(arguments.program, file, arguments.out / f"{number:04}")
        # The name in the table is the path in the repository; the first folder is the repository's.
        row |= {"path": path, "name": path.split("/", 1)[1], "repository": repository, "commit": commit,
                "bytes": file.stat().st_size}
        rows[path] = row
        with log.open("a", encoding="utf-8") as handle:
            handle.write(json.dumps(row) + "\n")
        print(f"{number + 1}/{len(wanted)} {outcome(row)} {row['seconds']:.1f} s {path} {row['faults'] or ''}", flush=True)
    version = run([arguments.program, "--version"])[1].strip()
    results = [rows[path] for path, _, _ in wanted]
    arguments.table.write_text(table(results, version), encoding="utf-8")
    sys.exit(1 if any(row["faults"] for row in results) else 0)


if __name__ == "__main__":
    main()
