"""Finds what of a lightmap lies inside other solids, such as the floor under the leg of a desk.

In: a Blender mesh with lightmap coordinates, its pages. Out: per page, which texels have a buried centre.

A lightmap baker may average a texel over its visible part only, because nobody sees the rest; Cycles averages over all of
it, and the buried part is black. A point is buried when the ray along its normal first meets the back of a single-sided
surface, or when another surface lies on it face to face: there rounding alone decides whether a ray leaves.

Source of the test: it is what lightmap bakers call texel validity; the implementation is ours. Limits: alpha is ignored.
"""

import bpy  # noqa: F401 (makes mathutils importable)
import numpy
from mathutils import Vector
from mathutils.bvhtree import BVHTree
from pictures import enlarged, interior
from texel_raster import Raster

# Distance of a ray's origin from its surface, as a part of the scene's diagonal (Blender computes in single precision).
OFFSET = 1e-5
# Cosine between the normals of two surfaces that lie on each other.
FACE_TO_FACE = -0.99
# A raster this many times coarser is looked at first; only where it does not agree with its neighbours, the full one is.
COARSER = 4


def buried(mesh, uv_layer, triangle_page, double_sided, sizes, coarser=COARSER):
    """Whether the centre of each texel is buried: a list of height × width arrays, row 0 on top.

    `triangle_page[i]` is the page of triangle i or −1; `double_sided[i]` tells whether its back is a surface too. What is
    smaller than `coarser` texels may be overlooked.
    """
    solids = Solids(mesh, uv_layer, triangle_page, double_sided)
    coarse_sizes = [tuple(-(-n // coarser) for n in size) for size in sizes]
    known = solids.look(coarse_sizes, [numpy.ones(size[::-1], bool) for size in coarse_sizes])
    if coarser == 1:
        return [k == BURIED for k in known]
    coarse = [enlarged(settled(k), coarser)[: size[1], : size[0]] for k, size in zip(known, sizes)]
    fine = solids.look(sizes, [c == UNKNOWN for c in coarse])
    return [numpy.where(c == UNKNOWN, f, c) == BURIED for c, f in zip(coarse, fine)]


# What is known of a texel's centre.
UNKNOWN, OPEN, BURIED = 0, 1, 2


def settled(known):
    """What all eight neighbours agree on; UNKNOWN elsewhere."""
    same = [state * interior(known == state) for state in (OPEN, BURIED)]
    return numpy.add(*same).astype(known.dtype)


class Solids(Raster):
    """The triangles of a mesh, to ask whether points on them are buried."""

    def __init__(self, mesh, uv_layer, triangle_page, double_sided):
        super().__init__(mesh, uv_layer, triangle_page)
        self.double_sided = double_sided
        self.tree = BVHTree.FromPolygons(self.vertices.tolist(), self.corners.tolist(), all_triangles=True)
        extent = self.vertices.max(axis=0) - self.vertices.min(axis=0)
        self.offset = OFFSET * float(numpy.linalg.norm(extent))

    def look(self, sizes, wanted):
        """What is known of the centres of the wanted texels of pages of these sizes."""
        known = [numpy.full(size[::-1], UNKNOWN, numpy.int8) for size in sizes]
        for i in self.with_page():
            page = self.triangle_page[i]
            x, y, weights = self.texels(i, sizes[page])
            keep = wanted[page][y, x]
            a, b, c = self.vertices[self.corners[i]].astype(numpy.float64)
            normal = numpy.cross(b - a, c - a)
            length = numpy.linalg.norm(normal)
            if length == 0.0 or not keep.any():
                continue
            direction = Vector(normal / length)
            for place, column, row in zip(self.place(i, weights[keep]), x[keep], y[keep]):
                known[page][row, column] = BURIED if self.covers(Vector(place), direction) else OPEN
        return known

    def covers(self, point, normal):
        """Whether a point on a surface with this normal is buried."""
        _, met, hit, _ = self.tree.ray_cast(point + normal * self.offset, normal)
        inside = hit is not None and not self.double_sided[hit] and met.dot(normal) > 0.0
        touching = self.tree.find_nearest_range(point, 2.0 * self.offset)
        return inside or any(found[1].dot(normal) < FACE_TO_FACE for found in touching)

