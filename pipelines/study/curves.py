"""Error against time: texelwalk beside Cycles, Cycles with its denoiser, and Mitsuba, on the same texels.

    python3 pipelines/study/curves.py OUT_DIR [--quick] [--scene NAME ...]

In: fixtures. Out, in OUT_DIR: curves.md, curves.csv, curves.png; tables on stdout. OUT_DIR/cache keeps what is not timed
(references, prepared scenes) by what it depends on, so a second call repeats the timed part only.

* Same texels: texelwalk charts the scene; Cycles and Mitsuba bake into that glTF's texture coordinates. Judged are clear
  texels (see checks/parity.py): interior to their chart, clear of other solids, so that they mean the same in all programs.
* Same machine, same threads, methods in turn, several rounds with other seeds; median of times, mean of squared errors.
* Two clocks. *Whole process*: from start to files on the disk. *Without start-up*: Cycles' bake operator (and denoiser);
  Mitsuba's sampling; texelwalk without reading, charts and writing.
* The judges are Cycles and Mitsuba, long, two halves each: texelwalk never judges itself. See figures.py for how their
  noise is kept out, and for how far they disagree. Without libLLVM, Mitsuba is left out, with a warning.
* Cycles samples the middle half of a texel only (cycles_job.py), so it is judged by references of middle halves; texelwalk
  and Mitsuba by references of whole texels. Nobody is charged for the other's idea of a texel.
* One Cycles process denoises its result with all filters; each method is charged for its own filter only. The normals that
  guide one of them come for free.

Prerequisites: cargo, Python 3.11 or 3.13 with venv, libLLVM 15 or newer for Mitsuba (Debian: libllvm15).
"""

import argparse
import csv
import hashlib
import json
import subprocess
import sys
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path

PIPELINES = Path(__file__).resolve().parents[1]
sys.path[1:1] = [str(PIPELINES / "checks"), str(PIPELINES / "paper")]

import environment  # noqa: E402 (its folder comes first)

environment.enter()

import numpy  # noqa: E402

import runs  # noqa: E402
import study_venv  # noqa: E402
import tables  # noqa: E402
from figures import References, Row  # noqa: E402
from gltf_file import GltfFile  # noqa: E402
from pictures import read_exr  # noqa: E402

FILTERS = ("RT", "RT+normal", "RTLightmap")
# Our methods: values of --splat.
OURS = ("share", "none", "paper")
# Stages that are start-up: reading, charts, writing. The hierarchy of the tracer stays in, as in Cycles' bake operator.
START_UP = ("load", "atlas", "encode")
PRODUCTION = tomllib.loads((PIPELINES / "presets" / "production.toml").read_text(encoding="utf-8"))
# Edge of what Cycles samples of a texel; see cycles_job.py.
CYCLES_FOOTPRINT = 0.5
REFERENCE_SEEDS = (1001, 1002)
TARGET_ERROR = 0.03


@dataclass(frozen=True)
class Place:
    """A scene to bake, with the radiance of its sky."""

    name: str
    sky: str = "0,0,0"


PLACES = (Place("cornell"), Place("office"), Place("courtyard", "0.35,0.45,0.65"), Place("room"))


@dataclass(frozen=True)
class Size:
    """How much is computed. Budgets of texelwalk are factors of the preset `production`; others are samples per texel."""

    texels: int
    rounds: int
    factors: tuple
    samples: tuple
    mitsuba_samples: tuple
    reference_samples: int
    mitsuba_reference_samples: int


FULL = Size(120_000, 3, (0.0625, 0.125, 0.25, 0.5, 1.0, 2.0), (1, 4, 16, 64), (4, 16, 64), 64, 256)
QUICK = Size(5_000, 1, (0.125, 1.0), (1, 8), (8,), 32, 128)


def say(sentence):
    sys.stderr.write(f"{time.strftime('%H:%M:%S')} {sentence}\n")


def job(python, script, *arguments):
    """Runs one process; returns its wall time [s]."""
    command = [str(python), str(Path(__file__).with_name(script)), *map(str, arguments)]
    started = time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
    wall = time.perf_counter() - started
    if done.returncode != 0:
        environment.fail(f"'{' '.join(command)}' ended with {done.returncode}: {done.stderr.strip()[-2000:]}")
    return wall


def mitsuba_python():
    """The Python in which Mitsuba runs, or None with a warning."""
    python = study_venv.python()
    probe = subprocess.run([str(python), str(Path(__file__).with_name("mitsuba_job.py")), "probe"],
                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False)
    if probe.returncode == 0:
        return python
    sys.stderr.write(f"warning: Mitsuba is left out, Cycles alone is the judge: {probe.stderr.strip()[-300:]}\n")
    return None


class Bench:
    """One scene: its atlas, its references, and bakes of it by every method."""

    def __init__(self, place, size, binary, mitsuba, out, threads):
        self.place, self.size, self.binary, self.mitsuba, self.threads = place, size, binary, mitsuba, threads
        self.scene = runs.scene_file(place.name)
        self.work = out / "runs" / place.name
        sky = () if place.sky == "0,0,0" else ("--sky", place.sky)
        base = (*sky, "--threads", threads, "--page-size", 4096)
        hasty = ("--direct-samples", 1, "--gather", 0)
        density, _ = runs.find_density(binary, self.scene, self.work, size.texels, (*base, *hasty))
        self.options = (*base, "--texels-per-meter", f"{density:.4f}")
        _, _, self.baked = runs.bake(binary, self.scene, self.work, "atlas", (*self.options, *hasty, "--lines", 1000))
        self.folder = out / "cache" / f"{place.name}-{self.key()[:16]}"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.sets = self.folder / "sets.npz"
        if not self.sets.is_file():
            say(f"{place.name}: preparing")
            job(sys.executable, "cycles_job.py", "prepare", self.baked, self.folder, place.sky)
        self.judged = numpy.load(self.sets)["clear"]
        self.whole, self.middle = self.make_references(True), self.make_references(False)

    def key(self):
        """Hash of everything that references depend on but their own samples and seeds."""
        gltf = GltfFile(self.baked)
        document = {k: v for k, v in gltf.json.items() if k not in ("asset", "textures", "images")}
        made = hashlib.sha256(json.dumps([document, self.place.sky], sort_keys=True).encode())
        for buffer in gltf.buffers:
            made.update(buffer)
        for file in (environment.REQUIREMENTS, study_venv.REQUIREMENTS):
            made.update(file.read_bytes())
        return made.hexdigest()

    def read(self, path):
        return numpy.load(path)["noisy"][self.judged].astype(numpy.float64)

    def make_references(self, whole):
        """Two halves by each renderer, of whole texels or of the middle halves that Cycles bakes."""
        made, part = {"cycles": [], "mitsuba": []}, "whole" if whole else "middle"
        for seed in REFERENCE_SEEDS:
            for renderer, bake, samples in (("cycles", self.cycles, self.size.reference_samples),
                                            ("mitsuba", self.mitsuba_bake, self.size.mitsuba_reference_samples)):
                if renderer == "mitsuba" and not self.mitsuba:
                    continue
                path = self.folder / f"{renderer}-{part}-{samples}-{seed}.npz"
                if not path.is_file():
                    say(f"{self.place.name}: reference by {renderer}, {part} texels, {samples} samples")
                    partial = path.with_name(f"partial-{path.name}")
                    bake(partial, samples, seed, (), whole)
                    partial.rename(path)
                made[renderer].append(self.read(path))
        return References(made["cycles"], made["mitsuba"])

    def cycles(self, out, samples, seed, filters=FILTERS, whole=False):
        wall = job(sys.executable, "cycles_job.py", "bake", self.folder, out, "--samples", samples, "--seed", seed,
                   "--threads", self.threads, *(("--whole",) if whole else ()), "--filters", *filters)
        return wall, json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))

    def mitsuba_bake(self, out, samples, seed, _=(), whole=True):
        wall = job(self.mitsuba, "mitsuba_job.py", "bake", self.baked, self.sets, out, self.place.sky, "--samples", samples,
                   "--seed", seed, "--threads", self.threads, "--footprint", 1.0 if whole else CYCLES_FOOTPRINT)
        return wall, json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))

    def texelwalk(self, method, factor, seed):
        """Texels, wall and core seconds of our bake."""
        scaled = {key: PRODUCTION[key] * factor for key in ("lines-per-texel", "gather", "direct-samples")}
        options = (*self.options, "--splat", method, "--seed", seed, "--lines-per-texel", scaled["lines-per-texel"],
                   *(word for key in ("gather", "direct-samples") for word in (f"--{key}", max(1, round(scaled[key])))))
        report, wall, baked = runs.bake(self.binary, self.scene, self.work, "timed", options)
        core = sum(stage["seconds"] for stage in report["stages"] if stage["name"] not in START_UP)
        pages = [read_exr(baked.parent / f"timed.lightmap{k}.exr")[..., :3] for k in range(report["atlas"]["pages"])]
        return numpy.concatenate([page.reshape(-1, 3) for page in pages])[self.judged].astype(numpy.float64), wall, core

    def measured(self, seed):
        """One round: (method, budget, texels, wall, core) of every method at every budget."""
        out = self.work / "timed.npz"
        for factor in self.size.factors:
            for method in OURS:
                yield f"texelwalk {method}", factor, *self.texelwalk(method, factor, seed)
        for samples in self.size.samples:
            wall, seconds = self.cycles(out, samples, seed)
            wall -= sum(seconds[kind] for kind in FILTERS)
            yield "Cycles", samples, self.read(out), wall, seconds["bake"]
            for kind in FILTERS:
                texels = numpy.load(out)[kind][self.judged].astype(numpy.float64)
                yield f"Cycles + OIDN {kind}", samples, texels, wall + seconds[kind], seconds["bake"] + seconds[kind]
        for samples in self.size.mitsuba_samples if self.mitsuba else ():
            wall, seconds = self.mitsuba_bake(out, samples, seed)
            yield "Mitsuba", samples, self.read(out), wall, seconds["bake"]

    def rows(self):
        """All rounds, as one row per method and budget."""
        found = {}
        for seed in range(1, self.size.rounds + 1):
            for method, budget, texels, wall, core in self.measured(seed):
                row = found.setdefault((method, budget), Row(method, budget))
                row.walls.append(wall)
                row.cores.append(core)
                judges = self.middle if method.startswith("Cycles") else self.whole
                row.squares.append([square / judges.mean() ** 2 for square in judges.against(texels)])
                say(f"{self.place.name} round {seed}: {method} {budget:g}: {wall:.2f} s, NRMSE {100 * row.error():.2f} %")
        return list(found.values())

    def facts(self):
        """What was compared, and how well the judges agree, as sentences."""
        sets, size = numpy.load(self.sets), self.size
        text = (f"{int(sets['charted'].sum()):,} texels, {int(self.judged.sum()):,} judged; {size.rounds} round(s), "
                f"{self.threads} thread(s). Judges: Cycles, 2 × {size.reference_samples} samples")
        if not self.mitsuba:
            return f"{text}; Mitsuba did not run."
        text += f", and Mitsuba, 2 × {size.mitsuba_reference_samples}."
        for name, judges in (("whole texels", self.whole), ("middle halves of texels", self.middle)):
            error, least = judges.disagreement()
            mean = sum(s.mean() for s in judges.second) / sum(f.mean() for f in judges.first) - 1.0
            text += (f" On {name} they disagree by {tables.percent(error)} (below {tables.percent(least)} is not told from zero), "
                     f"in mean by {tables.percent(mean)}.")
        apart = References(self.whole.first, self.middle.second).disagreement()[0]
        return f"{text} Between whole texels and middle halves lie {tables.percent(apart)}."


def write(out, texts, scenes):
    (out / "curves.md").write_text("\n".join(["# Error against time", "", *texts]) + "\n", encoding="utf-8")
    with open(out / "curves.csv", "w", newline="", encoding="utf-8") as handle:
        writer = csv.writer(handle, lineterminator="\n")
        writer.writerow(("scene", "method", "budget", "wall_seconds", "core_seconds", "nrmse", "nrmse_cycles", "nrmse_mitsuba", "rounds"))
        for name, rows in scenes.items():
            for row in rows:
                writer.writerow((name, row.method, row.budget, row.wall, row.core, row.error(), row.error(1), row.error(2), len(row.walls)))
    tables.plot(scenes, out / "curves.png", TARGET_ERROR)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--quick", action="store_true", help="about 5,000 texels per scene: shows that the study runs, no figures to quote")
    parser.add_argument("--scene", nargs="+", choices=[p.name for p in PLACES], default=[p.name for p in PLACES[:3]])
    parser.add_argument("--texels", type=int, help="charted texels per scene")
    parser.add_argument("--rounds", type=int)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--binary", type=Path, help="the texelwalk to measure; without it, cargo builds one")
    arguments = parser.parse_args()
    size = QUICK if arguments.quick else FULL
    size = Size(**{**size.__dict__, "texels": arguments.texels or size.texels, "rounds": arguments.rounds or size.rounds})
    arguments.out.mkdir(parents=True, exist_ok=True)
    out, binary, mitsuba = arguments.out.resolve(), arguments.binary or runs.build_binary(), mitsuba_python()
    texts, scenes = [], {}
    for place in (p for p in PLACES if p.name in arguments.scene):
        bench = Bench(place, size, binary, mitsuba, out, arguments.threads)
        scenes[place.name] = bench.rows()
        text = tables.scene_text(place.name, bench.facts(), scenes[place.name], TARGET_ERROR)
        print("\n".join(text), flush=True)
        texts += text
        write(out, texts, scenes)


if __name__ == "__main__":
    main()
