"""Errors, and what curves of error against time say.

In: texels of one bake and of two independent references. Out: squared errors free of noise in the references; rows of one
method and budget; times to reach an error; ratios at equal time.

Symbols, in this file only: x a bake, r and s two references with independent noise and the same expectation. Then
(x − r)(x − s) has the expectation (x − E r)², whatever the noise of r and s; its mean over many texels is the error, with
no noise to subtract. If the expectations differ by d, constant d costs at most d²/4, and is measured by `disagreement`.
"""

import math
import statistics
from dataclasses import dataclass, field


@dataclass
class References:
    """Two renderers, two halves each with independent noise; `second` is empty where only one renderer runs."""

    first: list
    second: list

    def mean(self):
        every = [*self.first, *self.second]
        return float(sum(half.mean() for half in every) / len(every))

    def against(self, x):
        """Squared errors: against both renderers at once, against the first alone, against the second alone."""
        one = product(x, *self.first)
        if not self.second:
            return one, one, math.nan
        return product(x, sum(self.first) / 2.0, sum(self.second) / 2.0), one, product(x, *self.second)

    def disagreement(self):
        """NRMSE between the renderers, free of noise in either; NaN where there is only one."""
        if not self.second:
            return math.nan
        a, b = ([f - s for f, s in zip(self.first, halves)] for halves in (self.second, self.second[::-1]))
        return signed_root(((a[0] * a[1]).mean() + (b[0] * b[1]).mean()) / 2.0) / self.mean()


def product(x, r, s):
    return float(((x - r) * (x - s)).mean())


def signed_root(value):
    """A measured mean square may be a little below zero; the root then is below zero too."""
    return math.copysign(math.sqrt(abs(value)), value)


@dataclass
class Row:
    """One method at one budget: medians of seconds, means of squared errors over the mean squared."""

    method: str
    budget: float
    walls: list = field(default_factory=list)
    cores: list = field(default_factory=list)
    squares: list = field(default_factory=list)

    @property
    def wall(self):
        return statistics.median(self.walls)

    @property
    def core(self):
        return statistics.median(self.cores)

    def error(self, which=0):
        """NRMSE against both renderers, the first, the second."""
        return signed_root(statistics.mean(s[which] for s in self.squares))

    @property
    def square(self):
        return max(statistics.mean(s[0] for s in self.squares), 1e-12)


def square_at(rows, seconds, clock, unbiased):
    """Squared error of a method at a time, by interpolation of logarithms; None where it has no result.

    Outside of what was measured, an unbiased method without noise sharing follows its law: error² × core seconds is constant.
    """
    rows = sorted(rows, key=lambda row: getattr(row, clock))
    first, last = rows[0], rows[-1]
    if seconds < getattr(first, clock):
        core = seconds - (getattr(first, clock) - first.core)
        return first.square * first.core / core if unbiased and core > 0.0 else None
    if seconds > getattr(last, clock):
        core = seconds - (getattr(last, clock) - last.core)
        return last.square * last.core / core if unbiased else min(row.square for row in rows)
    for a, b in zip(rows, rows[1:]):
        ta, tb = getattr(a, clock), getattr(b, clock)
        if ta <= seconds <= tb:
            share = math.log(seconds / ta) / math.log(tb / ta) if tb > ta else 0.0
            return math.exp((1.0 - share) * math.log(a.square) + share * math.log(b.square))
    return last.square


def time_to(rows, error, clock, unbiased):
    """Seconds to reach an NRMSE, and how they were found: "" measured, "<" below the first budget, "~" extrapolated."""
    rows = sorted(rows, key=lambda row: getattr(row, clock))
    wanted = error * error
    if rows[0].square <= wanted:
        return getattr(rows[0], clock), "<"
    for a, b in zip(rows, rows[1:]):
        if b.square <= wanted:
            share = math.log(wanted / a.square) / math.log(b.square / a.square)
            return math.exp((1.0 - share) * math.log(getattr(a, clock)) + share * math.log(getattr(b, clock))), ""
    if not unbiased:
        return None, ""
    last = rows[-1]
    return getattr(last, clock) - last.core + last.core * last.square / wanted, "~"
