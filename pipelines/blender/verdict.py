"""Says whether a lightmap agrees with two independent bakes of the same scene, by how much not, and where.

In: `Texels`, the same light three times: ours, and two bakes that differ in their random numbers alone. Out: figures with
their uncertainty, and sentences on what differs.

The reference of a texel is r = (a + b)/2, and (a − b)²/4 an unbiased estimate of its variance. So sums over texels have
known errors however few the samples are, and the mean of (o − a)(o − b) is the squared error of ours without the noise of
the reference (o, a, b: ours and the two). Our own noise is part of what is judged.

A difference counts where it exceeds what is allowed by more than `SIGMAS` standard errors: noise alone fails nothing. What
is too noisy to notice `NOTICED` times the allowed difference is a fault of its own: such a check would prove nothing.

Needs numpy only. Limits: errors of neighbouring texels are taken as independent, and as normal in sums.
"""

from dataclasses import dataclass

import numpy

# Standard errors beyond what is allowed: for one figure of the whole, and for one of many objects.
SIGMAS, SIGMAS_OF_MANY = 2.0, 3.5
# A difference this many times the allowed one must not hide in the noise.
NOTICED = 5.0
# An object must have this many texels to be judged by itself: fewer have a mean that is all border and contact.
LEAST_TEXELS = 24
# Differences of objects that are darker than this part of the mean of all are taken relative to it.
DARK = 0.1
# Edge of the squares of texels whose means are compared to find where the difference is, and texels that one must have.
SQUARE, LEAST_OF_SQUARE = 3, 4


@dataclass
class Texels:
    """Texels by row: colours (N × 3), page, row, column, index of the object (N each)."""

    ours: numpy.ndarray
    first: numpy.ndarray
    second: numpy.ndarray
    page: numpy.ndarray
    row: numpy.ndarray
    column: numpy.ndarray
    object: numpy.ndarray

    def only(self, keep):
        """Those for which `keep` holds."""
        return Texels(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))


@dataclass
class Figures:
    """Of a set of texels: ratio of means and its standard error; NRMSE with the ends of its 2σ range; noise of the reference."""

    texels: int
    ratio: float
    ratio_error: float
    nrmse: float
    nrmse_low: float
    nrmse_high: float
    noise: float


def figures(texels):
    """Compares all texels of a set."""
    ours, reference, error = sums(texels)
    total = max(reference.sum(), 1e-30)
    ratio = ours.sum() / total if ours.sum() > 0.0 or reference.sum() > 0.0 else 1.0
    squared = ((texels.ours - texels.first) * (texels.ours - texels.second)).mean(axis=1)
    count = max(len(squared), 1)
    mean, spread = squared.sum() / count, 2.0 * squared.std() / numpy.sqrt(count) if len(squared) else 0.0
    scale = total / count
    root = lambda x: float(numpy.sqrt(max(0.0, x)) / scale)  # noqa: E731
    noise = ((texels.first - texels.second) ** 2).sum() / max(texels.first.size, 1) / 4.0
    return Figures(len(ours), float(ratio), float(ratio * numpy.sqrt((error**2).sum()) / total),
                   root(mean), root(mean - spread), root(mean + spread), root(noise))


def sums(texels):
    """Means of the channels: ours, the reference, and the difference whose square is the reference's variance."""
    first, second = texels.first.mean(axis=1), texels.second.mean(axis=1)
    return texels.ours.mean(axis=1), (first + second) / 2.0, (first - second) / 2.0


@dataclass
class Difference:
    """Ours minus the reference over a group of texels, and its standard error, both relative to `scale`."""

    relative: float
    error: float
    ours: float
    reference: float
    texels: int

    def beyond(self, allowed, sigmas):
        return abs(self.relative) - allowed - sigmas * self.error


def of_objects(texels, count):
    """A `Difference` per object that has enough texels, by index."""
    ours, reference, error = sums(texels)
    add = lambda values: numpy.bincount(texels.object, values, minlength=count)  # noqa: E731
    groups = Groups(texels, numpy.bincount(texels.object, minlength=count), *(add(v) for v in (ours, reference, error**2)))
    return {int(i): groups.difference(i) for i in numpy.nonzero(groups.number >= LEAST_TEXELS)[0]}


class Groups:
    """Sums over groups of texels: numbers, ours, reference, variance of the reference's sum.

    Noise of Cycles has a long tail: a few texels that missed a rare, bright path look calm and too dark. So no group is
    taken to be less noisy than texels of its brightness are on the whole.
    """

    def __init__(self, texels, number, ours, reference, variance):
        _, every, error = sums(texels)
        self.number, count = number, numpy.maximum(number, 1)
        self.ours, self.reference = ours / count, reference / count
        pooled = (error**2).sum() / max((every**2).sum(), 1e-30)
        self.error = numpy.sqrt(numpy.maximum(variance / count, pooled * self.reference**2) / count)
        self.mean = max(every.mean(), 1e-30)
        self.scale = numpy.maximum(self.reference, DARK * self.mean)

    def difference(self, i):
        """The group's `Difference`."""
        relative = (self.ours[i] - self.reference[i]) / self.scale[i]
        return Difference(relative, self.error[i] / self.scale[i], self.ours[i], self.reference[i], int(self.number[i]))

    def surely_off(self):
        """By how much groups differ at least, as it strikes the eye: less is seen of a difference in bright light."""
        return (numpy.abs(self.ours - self.reference) - SIGMAS_OF_MANY * self.error) / (self.mean + self.reference)


def worst_places(texels, how_many):
    """Texels around which the difference is largest: list of (index into `texels`, `Difference`), not too close together."""
    ours, reference, error = sums(texels)
    squares = Groups(texels, *(around(texels, v) for v in (numpy.ones(len(ours)), ours, reference, error**2)))
    off = numpy.where(squares.number >= LEAST_OF_SQUARE, squares.surely_off(), -1.0)
    chosen = []
    for i in numpy.argsort(-off, kind="stable"):
        if off[i] <= 0.0 or len(chosen) == how_many:
            break
        if not any(close(texels, i, j) for j, _ in chosen):
            chosen.append((int(i), squares.difference(i)))
    return chosen


def close(texels, i, j):
    """Whether two texels are so near that one place stands for both."""
    apart = max(abs(texels.row[j] - texels.row[i]), abs(texels.column[j] - texels.column[i]))
    return texels.page[j] == texels.page[i] and apart < 3 * SQUARE


def around(texels, values):
    """Sums of values over the squares around the texels. Charts lie further apart than that, so squares stay on theirs."""
    result = numpy.zeros(len(values))
    half = SQUARE // 2
    for page in numpy.unique(texels.page):
        here = texels.page == page
        row, column = texels.row[here] + half, texels.column[here] + half
        grid = numpy.zeros((row.max() + half + 1, column.max() + half + 1))
        grid[row, column] = values[here]
        result[here] = sum(grid[row + y, column + x] for y in range(-half, half + 1) for x in range(-half, half + 1))
    return result


def percent(value, error=None):
    return f"{100.0 * value:.1f} %" + (f" ± {100.0 * error:.1f} %" if error is not None else "")


def brighter(relative):
    return "brighter" if relative > 0.0 else "darker"


def faults(whole, objects, names, allowed_mean, allowed_nrmse, allowed_object):
    """Sentences on what differs; empty where the two agree."""
    found, off = [], whole.ratio - 1.0
    if abs(off) > allowed_mean + SIGMAS * whole.ratio_error:
        found.append(f"the lightmap as a whole is {percent(abs(off), whole.ratio_error)} {brighter(off)} than Cycles; {percent(allowed_mean)} is allowed")
    elif SIGMAS * whole.ratio_error > (NOTICED - 1.0) * allowed_mean:
        found.append(f"Cycles is too noisy to judge by: its mean is known to {percent(whole.ratio_error)} only; raise --samples")
    if whole.nrmse_low > allowed_nrmse:
        found.append(f"texels differ by {percent(whole.nrmse)} NRMSE (at least {percent(whole.nrmse_low)}); {percent(allowed_nrmse)} is allowed")
    order = sorted(objects, key=lambda i: -objects[i].beyond(allowed_object, SIGMAS_OF_MANY))
    for i in order:
        d = objects[i]
        if d.beyond(allowed_object, SIGMAS_OF_MANY) > 0.0:
            found.append(f"object \"{names[i]}\" is {percent(abs(d.relative), d.error)} {brighter(d.relative)} than Cycles "
                         f"({d.ours:.4g} against {d.reference:.4g} over {d.texels} texels); {percent(allowed_object)} is allowed")
    return found
