"""Draws the figures of the experiment: time against MSE as in the paper's Fig. 6, and two views side by side."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as pyplot  # noqa: E402 (the backend comes first)
import numpy  # noqa: E402

from pictures import read_exr, write_png  # noqa: E402

# The paper draws the classic walk as a continuous line and the fuzzy one dashed.
STYLES = {"none": ("classic", "-", "black"), "paper": ("fuzzy, α 5 β 15", "--", "black"), "share": ("share", ":", "tab:blue")}


def time_error(rows, path):
    """Two panels: against each method's own reference (the paper's measure) and against the true solution."""
    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4.2), sharey=True)
    for panel, key, title in ((panels[0], "mse_own", "own reference, as in the paper"), (panels[1], "mse_truth", "true solution")):
        for method, (label, line, color) in STYLES.items():
            points = sorted((r["walk_seconds"], r[key]) for r in rows if r["method"] == method)
            panel.plot(*zip(*points), line, color=color, marker="o", markersize=3, label=label)
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xlabel("time of the walk [s]")
        panel.set_title(f"{rows[0]['scene']}, {rows[0]['patches']} patches: {title}", fontsize=9)
        panel.grid(True, which="both", linewidth=0.3)
    panels[0].set_ylabel("MSE of E/π")
    panels[0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def side_by_side(paths, path):
    views = [read_exr(p)[..., :3] for p in paths]
    gap = numpy.ones((views[0].shape[0], 8, 3))
    write_png(path, numpy.concatenate([views[0], gap, *views[1:]], axis=1))
