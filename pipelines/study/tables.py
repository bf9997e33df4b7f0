"""Writes the curves as tables and draws them."""

import math

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as pyplot  # noqa: E402 (the backend comes first)

import figures  # noqa: E402

OURS = "texelwalk share"
# Without bias and without sharing of noise: their squared error goes with 1/time, so they may be extrapolated.
UNBIASED = ("Cycles", "Mitsuba")
COLORS = {"texelwalk": "tab:red", "Cycles": "tab:blue", "Cycles+": "tab:cyan", "Mitsuba": "tab:green"}
DASHES = {"share": "-", "none": "--", "paper": ":", "RT": ":", "RT+normal": "--", "RTLightmap": "-."}
CLOCKS = {"wall": "whole process", "core": "without start-up"}


def methods(rows):
    return list(dict.fromkeys(row.method for row in rows))


def of(rows, method):
    return [row for row in rows if row.method == method]


def budget_table(rows):
    text = ["| method | budget | whole process s | without start-up s | NRMSE | against Cycles | against Mitsuba | NRMSE² × s | × ours |",
            "|---|---|---|---|---|---|---|---|---|"]
    best = min((row.square * row.core for row in of(rows, OURS)), default=math.nan)
    for row in sorted(rows, key=lambda r: (methods(rows).index(r.method), r.budget)):
        cost = row.square * row.core
        error = f"{percent(row.error())} ± {100.0 * row.uncertainty():.2f} | {percent(row.error(1))} | {percent(row.error(2))}"
        text.append(f"| {row.method} | {row.budget:g} | {row.wall:.2f} | {row.core:.2f} | {error} | {cost:.2e} | {cost / best:.2f} |")
    return text


def percent(value):
    return "–" if math.isnan(value) else f"{100.0 * value:.2f} %"


def reach_table(rows, error):
    """Seconds to reach an error, and over ours."""
    text = [f"| to {100 * error:g} % NRMSE | whole process s | × ours | without start-up s | × ours |", "|---|---|---|---|---|"]
    ours = {clock: figures.time_to(of(rows, OURS), error, clock, False)[0] for clock in CLOCKS}
    for method in methods(rows):
        cells = []
        for clock in CLOCKS:
            seconds, how = figures.time_to(of(rows, method), error, clock, method in UNBIASED)
            cells.append("not reached | –" if seconds is None else
                         f"{how}{seconds:.2f} | {'–' if ours[clock] is None else f'{seconds / ours[clock]:.1f}'}")
        text.append(f"| {method} | {' | '.join(cells)} |")
    return text


def equal_time_table(rows, clock):
    """Squared error of the others over ours, at the times of our budgets."""
    others = [method for method in methods(rows) if method != OURS]
    text = [f"| ours, {CLOCKS[clock]} s | our NRMSE | {' | '.join(others)} |", "|---|---|" + "---|" * len(others)]
    for row in sorted(of(rows, OURS), key=lambda r: r.budget):
        seconds = getattr(row, clock)
        squares = [figures.square_at(of(rows, method), seconds, clock, method in UNBIASED) for method in others]
        cells = ["–" if square is None else f"{square / row.square:.2f}" for square in squares]
        text.append(f"| {seconds:.2f} | {percent(row.error())} | {' | '.join(cells)} |")
    return text


def scene_text(name, facts, rows, error):
    """All tables of one scene."""
    text = [f"## {name}", "", facts, "", *budget_table(rows), "", *reach_table(rows, error), ""]
    for clock in CLOCKS:
        text += [f"Squared error over ours at equal time, {CLOCKS[clock]} (– : nothing baked yet):", "", *equal_time_table(rows, clock), ""]
    return text


def style(method):
    family, _, kind = method.partition(" ")
    denoised = family == "Cycles" and kind
    return {"color": COLORS["Cycles+" if denoised else family], "linestyle": DASHES.get(kind.removeprefix("+ OIDN "), "-"), "label": method}


def plot(scenes, path, error):
    """One column per scene, one row per clock."""
    figure, panels = pyplot.subplots(len(CLOCKS), len(scenes), figsize=(4.6 * len(scenes), 7.6), squeeze=False)
    for column, (name, rows) in enumerate(scenes.items()):
        for panel, (clock, label) in zip(panels[:, column], CLOCKS.items()):
            for method in methods(rows):
                points = sorted((getattr(row, clock), 100.0 * math.sqrt(row.square)) for row in of(rows, method))
                panel.plot(*zip(*points), marker="o", markersize=3, **style(method))
            panel.axhline(100.0 * error, color="gray", linewidth=0.6)
            panel.set_xscale("log")
            panel.set_yscale("log")
            panel.set_xlabel(f"seconds, {label}")
            panel.set_title(name, fontsize=9)
            panel.grid(True, which="both", linewidth=0.3)
    for panel in panels[:, 0]:
        panel.set_ylabel("NRMSE [%]")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="lower center", ncols=3, fontsize=7)
    figure.tight_layout(rect=(0.0, 0.08, 1.0, 1.0))
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
