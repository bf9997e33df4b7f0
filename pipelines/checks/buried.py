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


class Solids:
    """The triangles of a mesh, to ask whether points on them are buried."""

    def __init__(self, mesh, uv_layer, triangle_page, double_sided):
        self.vertices = numpy.empty((len(mesh.vertices), 3), numpy.float32)
        mesh.vertices.foreach_get("co", self.vertices.ravel())
        corners = numpy.empty(len(mesh.loops), numpy.int32)
        mesh.loops.foreach_get("vertex_index", corners)
        self.corners = corners.reshape(-1, 3)
        uv = numpy.empty((len(mesh.loops), 2), numpy.float32)
        mesh.uv_layers[uv_layer].uv.foreach_get("vector", uv.ravel())
        self.uv = uv.reshape(-1, 3, 2)
        self.triangle_page, self.double_sided = triangle_page, double_sided
        self.tree = BVHTree.FromPolygons(self.vertices.tolist(), self.corners.tolist(), all_triangles=True)
        extent = self.vertices.max(axis=0) - self.vertices.min(axis=0)
        self.offset = OFFSET * float(numpy.linalg.norm(extent))

    def look(self, sizes, wanted):
        """What is known of the centres of the wanted texels of pages of these sizes."""
        known = [numpy.full(size[::-1], UNKNOWN, numpy.int8) for size in sizes]
        for i in numpy.nonzero(self.triangle_page >= 0)[0]:
            page = self.triangle_page[i]
            width, height = sizes[page]
            # Blender's v runs up; rows run down.
            flat = numpy.stack([self.uv[i, :, 0] * width, (1.0 - self.uv[i, :, 1]) * height], axis=1).astype(numpy.float64)
            points, weights = points_inside(flat)
            x, y = numpy.floor(points).astype(int).T
            keep = (x >= 0) & (x < width) & (y >= 0) & (y < height)
            keep[keep] = wanted[page][y[keep], x[keep]]
            a, b, c = self.vertices[self.corners[i]].astype(numpy.float64)
            normal = numpy.cross(b - a, c - a)
            length = numpy.linalg.norm(normal)
            if length == 0.0 or not keep.any():
                continue
            direction = Vector(normal / length)
            for place, column, row in zip(weights[keep] @ self.vertices[self.corners[i]], x[keep], y[keep]):
                known[page][row, column] = BURIED if self.covers(Vector(place), direction) else OPEN
        return known

    def covers(self, point, normal):
        """Whether a point on a surface with this normal is buried."""
        _, met, hit, _ = self.tree.ray_cast(point + normal * self.offset, normal)
        inside = hit is not None and not self.double_sided[hit] and met.dot(normal) > 0.0
        touching = self.tree.find_nearest_range(point, 2.0 * self.offset)
        return inside or any(found[1].dot(normal) < FACE_TO_FACE for found in touching)


def points_inside(triangle):
    """Centres of texels inside a triangle given in texels, and their barycentric weights."""
    low = numpy.floor(triangle.min(axis=0)).astype(int)
    high = numpy.ceil(triangle.max(axis=0)).astype(int)
    x = numpy.arange(low[0], high[0]) + 0.5
    y = numpy.arange(low[1], high[1]) + 0.5
    points = numpy.stack(numpy.meshgrid(x, y), axis=-1).reshape(-1, 2)
    a, b, c = triangle
    area = cross(b - a, c - a)
    if area == 0.0 or not len(points):
        return points[:0], numpy.zeros((0, 3))
    weights = numpy.stack([cross(c - b, points - b), cross(a - c, points - c), cross(b - a, points - a)], axis=1) / area
    inside = (weights >= 0.0).all(axis=1)
    return points[inside], weights[inside]


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
