"""Compares the ray queries of texelwalk with Embree's: the same triangles and rays, the same threads, the same run.

In: nothing; options --details, --threads, --passes, --rounds. Out: a table on stdout; ratios above 1 mean that texelwalk
is faster.

* Embree comes from the Python wheel in requirements.txt (libembree4, without headers). The wheel's Python interface
  knows batches only, so embree.cpp beside this file calls rtcIntersect1 and rtcOccluded1, one ray per call.
* tests/bench/rays.rs dumps its triangles and rays and measures them, 64 rays per query, as walk and gather ask for
  many, too (shadow rays are asked for one by one); both programs take batches of 250 rays, pass after pass, and add up
  each batch's best time. The two take turns, round by round; the table has the best round.
* The numbers of hits have to agree: with robust mode exactly, else up to 1 ray in 10,000 (exit code 1).

Prerequisites: cargo, a C++ compiler (c++, or $CXX), Python 3 with venv.
"""

import argparse
import os

from study_venv import HERE, ROOT, VENV, WORK, python
from environment import fail, locked, run  # noqa: E402,I001 (study_venv finds its folder)

MODES = ("medium", "robust")
# What else the bench can do: without AVX2, rays that do not say which triangle they leave, and one ray per call.
KINDS = {"portable": ["--portable"], "from nowhere": ["--from-nowhere"], "one by one": ["--together", "1"]}


def library():
    """Path of libembree4 in the environment of the studies."""
    python()
    found = sorted(VENV.glob("lib/python*/site-packages/embreex.libs/libembree4*.so*"))
    if not found:
        fail("the wheel has no libembree4; this script knows the Linux wheels only")
    return found[0]


def compile_embree():
    shared, program = library(), WORK / "embree"
    run("compiling embree.cpp", [os.environ.get("CXX", "c++"), "-O2", "-std=c++17", "-pthread", "-o", program,
                                 HERE / "embree.cpp", shared, f"-Wl,-rpath,{shared.parent}"])
    return program


def rows(text):
    """Figures by number of triangles: seconds to build, ns per closest hit, ns per occlusion, hits, occluded rays."""
    out = {}
    for line in text.splitlines():
        fields = line.split(",")
        if fields[0].isdigit():
            out[int(fields[0])] = [float(fields[i]) for i in (2, 5, 6, 7, 8)]
    return out


def best(old, new):
    """The smaller times; counts stay."""
    return new if old is None else [min(a, b) for a, b in zip(old[:3], new[:3])] + new[3:]


def measure(options, bench, embree):
    """Best figures by (program, number of triangles)."""
    figures = {}
    for round_number in range(options.rounds):
        command = [*bench, "--details", options.details, "--threads", options.threads, "--passes", options.passes]
        if round_number == 0:
            command += ["--dump", WORK]
        ours = rows(run("the ray bench", command, cwd=ROOT))
        results = {"texelwalk": ours}
        for name, option in KINDS.items():
            results[name] = rows(run("the ray bench", [*command, *option], cwd=ROOT))
        for mode in MODES:
            sizes = [str(n) for n in ours]
            results[mode] = rows(run("Embree", [embree, WORK, options.threads, options.passes, mode, *sizes]))
        for program, table in results.items():
            for n, row in table.items():
                figures[program, n] = best(figures.get((program, n)), row)
    return figures


def report(figures):
    """Prints the table; whether the counts agree."""
    agree = True
    print("| triangles | program | build s | closest ns | occlusion ns | closest × | occlusion × | build × |")
    print("|---|---|---|---|---|---|---|---|")
    for n in sorted({n for _, n in figures}):
        ours = figures["texelwalk", n]
        for program in ("texelwalk", *KINDS, *MODES):
            row = figures[program, n]
            ratios = "| | | |" if program == "texelwalk" else \
                f"| {row[1] / ours[1]:.2f} | {row[2] / ours[2]:.2f} | {ours[0] / row[0]:.2f} |"
            print(f"| {n} | {program} | {row[0]:.4f} | {row[1]:.0f} | {row[2]:.0f} {ratios}")
            allowed = 50 if program == "medium" else 0
            agree &= all(abs(a - b) <= allowed for a, b in zip(row[3:], ours[3:]))
    print("\nTimes are those of one thread for one ray. × is the program's time over texelwalk's; for building, the other way.")
    return agree


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--details", default="8,25,79", help="sizes, as the bench counts them")
    parser.add_argument("--threads", default="2")
    parser.add_argument("--passes", default="5")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with locked(WORK / "lock"):
        embree = compile_embree()
        bench = ["cargo", "bench", "--quiet", "--locked", "--bench", "rays", "--"]
        if not report(measure(options, bench, embree)):
            fail("texelwalk and Embree disagree on what is hit")


if __name__ == "__main__":
    main()
