"""Errors, and what curves of error against time say.

In: texels of one bake and of two independent references. Out: squared errors free of noise in the references; rows of one
method and budget; times to reach an error; ratios at equal time.

Symbols, in this file only: x a bake, r and s two references with independent noise and the same expectation. Then
(x − r)(x − s) has the expectation (x − E r)², whatever the noise of r and s; its mean over many texels is the error, with
no noise to subtract. Where the two renderers differ by d in expectation, that is d²/4 less than the error against their
middle; `disagreement` measures d.
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
        """Squared errors: against both renderers at once, against the first alone, against the second alone; and the
        standard error of the first of these."""
        one = products(x, *self.first)
        if not self.second:
            return one.mean(), one.mean(), math.nan, standard_error(one)
        both = products(x, sum(self.first) / 2.0, sum(self.second) / 2.0)
        return both.mean(), one.mean(), products(x, *self.second).mean(), standard_error(both)

    def disagreement(self):
        """NRMSE between the renderers, free of noise in either, and the error of zero that would look like one
        standard error of it."""
        f, s = self.first, self.second
        # (f0 − s0)(f1 − s1) and (f0 − s1)(f1 − s0): every difference meets one with independent noise.
        found = (((f[0] - s[0]) * (f[1] - s[1]) + (f[0] - s[1]) * (f[1] - s[0])) / 2.0).mean(axis=-1)
        return signed_root(found.mean()) / self.mean(), math.sqrt(standard_error(found)) / self.mean()


def products(x, r, s):
    """(x − r)(x − s) of every texel, mean over its channels."""
    return ((x - r) * (x - s)).mean(axis=-1)


def standard_error(values):
    return float(values.std() / math.sqrt(len(values)))


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

    def uncertainty(self):
        """Standard error of the NRMSE; rounds share the references, so they do not lower it."""
        return self.squares[0][3] / (2.0 * math.sqrt(self.square))

    @property
    def square(self):
        return max(statistics.mean(s[0] for s in self.squares), 1e-12)


def beyond(rows, clock):
    """How an unbiased method goes on after its last budget n: squared error ∝ n^−p, and seconds per unit of budget.

    Both from the last two budgets; p is 1 for random samples, and up to 1.2 was seen with the well-spread ones of Cycles.
    """
    last = rows[-1]
    if len(rows) == 1:
        return 1.0, last.core / last.budget
    before = rows[-2]
    power = math.log(before.square / last.square) / math.log(last.budget / before.budget)
    return max(power, 1.0), (getattr(last, clock) - getattr(before, clock)) / (last.budget - before.budget)


def square_at(rows, seconds, clock, unbiased):
    """Squared error of a method at a time, by interpolation of logarithms; None where it has no result yet.

    After the last budget an unbiased method goes on as it did; one with bias is given its best result.
    """
    rows = sorted(rows, key=lambda row: row.budget)
    last = rows[-1]
    if seconds < getattr(rows[0], clock):
        return None
    for a, b in zip(rows, rows[1:]):
        ta, tb = getattr(a, clock), getattr(b, clock)
        if ta <= seconds < tb:
            share = math.log(seconds / ta) / math.log(tb / ta)
            return math.exp((1.0 - share) * math.log(a.square) + share * math.log(b.square))
    if not unbiased:
        return min(row.square for row in rows)
    power, each = beyond(rows, clock)
    return last.square * (1.0 + (seconds - getattr(last, clock)) / (each * last.budget)) ** -power


def time_to(rows, error, clock, unbiased):
    """Seconds to reach an NRMSE, and how they were found: "" measured, "<" below the first budget, "~" extrapolated."""
    rows = sorted(rows, key=lambda row: row.budget)
    wanted = error * error
    if rows[0].square <= wanted:
        return getattr(rows[0], clock), "<"
    for a, b in zip(rows, rows[1:]):
        if b.square <= wanted:
            share = math.log(wanted / a.square) / math.log(b.square / a.square)
            return math.exp((1.0 - share) * math.log(getattr(a, clock)) + share * math.log(getattr(b, clock))), ""
    if not unbiased:
        return None, ""
    last, (power, each) = rows[-1], beyond(rows, clock)
    return getattr(last, clock) + each * last.budget * ((last.square / wanted) ** (1.0 / power) - 1.0), "~"
