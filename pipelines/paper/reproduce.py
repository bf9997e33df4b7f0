"""Repeats the experiment of "Fuzzy Random Walk" (Castro, Feixas, Sbert), section 4, with one command.

    python3 pipelines/paper/reproduce.py OUT_DIR [--quick]

In: fixtures/office and fixtures/room, at the densities that give about 7,000 and 25,000 patches. Out, in OUT_DIR:
table.md and table.csv, fig6-office.png and fig6-room.png (time against MSE), fig4-office.png and fig5-room.png (classic on
the left, fuzzy on the right).

Methods: `none` is the classic walk, `paper` the fuzzy walk with α = 5 and β = 15, `share` is ours. Light is shot from the
emitters, no final gather. What is measured:

* MSE over RGB of E/π, mean over seeds, twice: against the method's own reference, as in the paper (which hides the bias),
  and against the true solution, for which the reference of `none` stands (it is unbiased).
* Both in three ways: over whole patches, which is what the paper's scenes are made of; over all patches, weighted by
  area; over all patches alike. The borders of our charts cut patches into slivers, and the smaller a sliver, the noisier
  it is; the paper's splat moreover gives it as much light as a whole neighbour.
* Times: seconds of the stage `walk` and of the whole process, median over seeds. Methods are run in turn, so that a slow minute
  of the machine hits all of them.

Limits: these are not the paper's scenes (lost), only scenes like the ones it describes. References have ≥ 60 M lines, so
about lines/60 M of an MSE is the reference's own noise. EXR pages are half floats (relative rounding 5e-4).
"""

import argparse
import csv
import statistics
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "checks"))

import environment  # noqa: E402 (its folder comes first)

environment.enter()

import numpy  # noqa: E402

import plots  # noqa: E402
import runs  # noqa: E402

METHODS = ("none", "paper", "share")
BUDGET_FACTORS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0)
# Columns: whole patches, all patches by area, all patches alike.
ERRORS = ("mse_own", "mse_own_area", "mse_own_all", "mse_truth", "mse_truth_area", "mse_truth_all")
REFERENCE_SEED = 1_000_003
# At the paper's own number of lines every method is timed this often more per seed: a median of three is no figure.
TIMED_AGAIN = 3


@dataclass(frozen=True)
class Experiment:
    """One of the paper's scenes, with its patches and lines."""

    name: str
    patches: int
    lines: int
    figure: str


EXPERIMENTS = (Experiment("office", 7_000, 514_000, "fig4-office.png"), Experiment("room", 25_000, 1_430_000, "fig5-room.png"))


def mean_squared_errors(run, reference):
    """Over whole patches, over all by area, over all alike."""
    if run.radiosity.shape != reference.radiosity.shape:
        environment.fail(f"{run.baked} and {reference.baked} have different patches: {run.radiosity.shape}, {reference.radiosity.shape}")
    squared = ((run.radiosity - reference.radiosity) ** 2).mean(axis=1)
    whole = run.share == 1.0
    return float(squared[whole].mean()), float((squared * run.share).sum() / run.share.sum()), float(squared.mean())


def options(method, lines, seed, base):
    return (*base, "--splat", method, "--lines", lines, "--seed", seed)


def measure(binary, experiment, arguments, out):
    """All runs of one scene; returns its rows."""
    scene, folder = runs.scene_file(experiment.name), out / "runs" / experiment.name
    base = (*runs.PAPER_OPTIONS, "--threads", arguments.threads)
    density, patches = runs.find_density(binary, scene, folder, experiment.patches, base)
    base = (*base, "--texels-per-meter", f"{density:.4f}")
    sys.stderr.write(f"{experiment.name}: {patches} patches at {density:.3f} texels per metre\n")
    references = {m: runs.reference(binary, scene, folder, f"reference-{m}", options(m, arguments.reference_lines, REFERENCE_SEED, base)) for m in METHODS}
    truth = references["none"]
    samples, times = {}, {}
    for seed in range(1, arguments.seeds + 1):
        for factor in arguments.budgets:
            lines = round(experiment.lines * factor)
            for method in METHODS:
                keep = seed == 1 and factor == 1.0
                name = f"headline-{method}" if keep else "run"
                run = runs.read_run(*runs.bake(binary, scene, folder, name, options(method, lines, seed, base)))
                sys.stderr.write(f"{experiment.name} seed {seed} {method:<5} {lines:>8} lines, walk {run.walk_seconds:.2f} s\n")
                errors = (*mean_squared_errors(run, references[method]), *mean_squared_errors(run, truth))
                samples.setdefault((method, lines), []).append(errors)
                times.setdefault((method, lines), []).append((run.walk_seconds, run.wall_seconds))
            for _ in range(TIMED_AGAIN if factor == 1.0 else 0):
                for method in METHODS:
                    run = runs.read_run(*runs.bake(binary, scene, folder, "run", options(method, lines, seed, base)))
                    times[method, lines].append((run.walk_seconds, run.wall_seconds))
    mean = float(truth.radiosity[truth.share == 1.0].mean())
    return [row(experiment, patches, mean, key, values, times[key]) for key, values in sorted(samples.items(), key=lambda kv: kv[0][1])]


def row(experiment, patches, mean, key, values, times):
    errors = dict(zip(ERRORS, map(statistics.mean, zip(*values))))
    walk, process = map(statistics.median, zip(*times))
    return {
        "scene": experiment.name, "patches": patches, "method": key[0], "lines": key[1], "seeds": len(values), **errors,
        "nrmse_truth": errors["mse_truth"] ** 0.5 / mean, "walk_seconds": walk, "process_seconds": process,
    }


def find(rows, scene, method, lines):
    return next(r for r in rows if (r["scene"], r["method"], r["lines"]) == (scene, method, lines))


def claim_table(rows, experiments):
    """The paper's claim: MSE against each method's own reference, and the price in time."""
    text = ["| scene | lines | MSE classic | MSE fuzzy | ratio | all patches, by area | all alike | walk, classic → fuzzy | time ratio | process |",
            "|---|---|---|---|---|---|---|---|---|---|"]
    for e in experiments:
        a, b = find(rows, e.name, "none", e.lines), find(rows, e.name, "paper", e.lines)
        text.append(
            f"| {e.name}, {a['patches']} patches | {e.lines:,} | {a['mse_own']:.3e} | {b['mse_own']:.3e} "
            f"| **{b['mse_own'] / a['mse_own']:.3f}** | {b['mse_own_area'] / a['mse_own_area']:.3f} | {b['mse_own_all'] / a['mse_own_all']:.3f} "
            f"| {a['walk_seconds']:.2f} s → {b['walk_seconds']:.2f} s | {b['walk_seconds'] / a['walk_seconds']:.3f} "
            f"| {b['process_seconds'] / a['process_seconds']:.3f} |")
    return text


def truth_table(rows):
    """Against the true solution: what the paper did not show."""
    text = ["| scene | lines | NRMSE none | NRMSE paper | NRMSE share | MSE paper / none | by area | MSE share / none | by area |",
            "|---|---|---|---|---|---|---|---|---|"]
    for scene, lines in sorted({(r["scene"], r["lines"]) for r in rows}):
        a, b, c = (find(rows, scene, m, lines) for m in METHODS)
        text.append(f"| {scene} | {lines:,} | {a['nrmse_truth']:.4f} | {b['nrmse_truth']:.4f} | {c['nrmse_truth']:.4f} "
                    f"| **{b['mse_truth'] / a['mse_truth']:.2f}** | {b['mse_truth_area'] / a['mse_truth_area']:.2f} "
                    f"| {c['mse_truth'] / a['mse_truth']:.2f} | {c['mse_truth_area'] / a['mse_truth_area']:.2f} |")
    return text


def write_tables(out, rows, arguments, experiments):
    with open(out / "table.csv", "w", newline="", encoding="utf-8") as handle:
        writer = csv.DictWriter(handle, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    text = ["# Fuzzy random walk, the paper's experiment repeated", "",
            f"{arguments.seeds} seeds, references of {arguments.reference_lines:,} lines, {arguments.threads} thread(s), options "
            f"`{' '.join(runs.PAPER_OPTIONS)}`. Over whole patches unless a column says otherwise.", "",
            "## Each method against its own reference (the paper's measure)", "", *claim_table(rows, experiments), "",
            "## Every method against the true solution", "", *truth_table(rows), "",
            "All runs: table.csv. Pictures: fig4-office.png, fig5-room.png (classic left, fuzzy right), fig6-*.png.", ""]
    (out / "table.md").write_text("\n".join(text), encoding="utf-8")
    print("\n".join(text))


def write_pictures(binary, experiment, out):
    """Classic and fuzzy side by side at the paper's number of lines, through the scene's first camera."""
    views = []
    for method in ("none", "paper"):
        folder = out / "runs" / experiment.name
        view = folder / f"view-{method}.png"
        command = [str(binary), "render", str(folder / f"headline-{method}.glb"), "-o", str(view), "--camera", "0"]
        done = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False)
        if done.returncode != 0:
            environment.fail(f"'{' '.join(command)}' ended with {done.returncode}: {done.stderr.strip()[-2000:]}")
        views.append(view)
    plots.side_by_side(views, out / experiment.figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--quick", action="store_true", help="4 M reference lines and three budgets: minutes become seconds, figures rough")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--scene", choices=[e.name for e in EXPERIMENTS], help="one scene only")
    arguments = parser.parse_args()
    arguments.reference_lines = 4_000_000 if arguments.quick else 64_000_000
    arguments.budgets = (0.125, 0.5, 1.0) if arguments.quick else BUDGET_FACTORS
    arguments.out.mkdir(parents=True, exist_ok=True)
    experiments = [e for e in EXPERIMENTS if arguments.scene in (None, e.name)]
    binary, rows = runs.build_binary(), []
    for experiment in experiments:
        rows += measure(binary, experiment, arguments, arguments.out)
        plots.time_error([r for r in rows if r["scene"] == experiment.name], arguments.out / f"fig6-{experiment.name}.png")
        write_pictures(binary, experiment, arguments.out)
    write_tables(arguments.out, rows, arguments, experiments)
    if not all(numpy.isfinite(r["mse_truth"]) for r in rows):
        environment.fail("an error is not a finite number")


if __name__ == "__main__":
    main()
