"""Finds lightmap texels that lie partly inside other solids, such as the floor under the leg of a desk.

In: a Blender mesh with lightmap coordinates, its pages. Out: per page, the share of each texel that is buried.

A lightmap baker may average a texel over its visible part only, because nobody sees the rest; Cycles averages over all of
it, and the buried part is black. Both are right, so such texels say nothing about the light. A point is buried when the
ray along its normal first meets the back of a single-sided surface, or when another surface lies on it face to face: there
rounding alone decides whether a ray leaves.

Source of the test: it is what lightmap bakers call texel validity; the implementation is ours. Limits: alpha is ignored.
"""

import bpy  # noqa: F401 (makes mathutils importable)
import numpy
from mathutils import Vector
from mathutils.bvhtree import BVHTree

# Points per texel edge. Four find anything wider than a quarter of a texel.
POINTS = 4
# Distance of a ray's origin from its surface, as a part of the scene's diagonal (Blender computes in single precision).
OFFSET = 1e-5
# Cosine between the normals of two surfaces that lie on each other.
FACE_TO_FACE = -0.99


def buried_share(mesh, uv_layer, triangle_page, double_sided, sizes):
    """Share of each texel that is buried: a list of height × width arrays, row 0 on top.

    `triangle_page[i]` is the page of triangle i or −1; `double_sided[i]` tells whether its back is a surface too.
    """
    vertices = numpy.empty((len(mesh.vertices), 3), numpy.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    corners = numpy.empty(len(mesh.loops), numpy.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    corners = corners.reshape(-1, 3)
    uv = numpy.empty((len(mesh.loops), 2), numpy.float32)
    mesh.uv_layers[uv_layer].uv.foreach_get("vector", uv.ravel())
    uv = uv.reshape(-1, 3, 2)
    tree = BVHTree.FromPolygons(vertices.tolist(), corners.tolist(), all_triangles=True)
    offset = OFFSET * float(numpy.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0)))
    total = [numpy.zeros(size[::-1]) for size in sizes]
    hidden = [numpy.zeros(size[::-1]) for size in sizes]
    for i in numpy.nonzero(triangle_page >= 0)[0]:
        page = triangle_page[i]
        width, height = sizes[page]
        # Blender's v runs up; rows run down.
        flat = numpy.stack([uv[i, :, 0] * width, (1.0 - uv[i, :, 1]) * height], axis=1).astype(numpy.float64)
        points, weights = points_inside(flat)
        if not len(points):
            continue
        places = weights @ vertices[corners[i]]
        a, b, c = vertices[corners[i]].astype(numpy.float64)
        normal = numpy.cross(b - a, c - a)
        length = numpy.linalg.norm(normal)
        if length == 0.0:
            continue
        direction = Vector(normal / length)
        texels = numpy.floor(points).astype(int)
        for place, (x, y) in zip(places, texels):
            if not (0 <= x < width and 0 <= y < height):
                continue
            total[page][y, x] += 1
            point = Vector(place)
            _, met, hit, _ = tree.ray_cast(point + direction * offset, direction)
            inside = hit is not None and not double_sided[hit] and met.dot(direction) > 0.0
            if inside or any(found[1].dot(direction) < FACE_TO_FACE for found in tree.find_nearest_range(point, 2.0 * offset)):
                hidden[page][y, x] += 1
    return [h / numpy.maximum(t, 1) for h, t in zip(hidden, total)]


def points_inside(triangle):
    """Points of the sub-texel grid inside a triangle given in texels, and their barycentric weights."""
    low = numpy.floor(triangle.min(axis=0) * POINTS).astype(int)
    high = numpy.ceil(triangle.max(axis=0) * POINTS).astype(int)
    x = (numpy.arange(low[0], high[0]) + 0.5) / POINTS
    y = (numpy.arange(low[1], high[1]) + 0.5) / POINTS
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
