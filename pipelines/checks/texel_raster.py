"""Finds which triangle lies under the centre of a lightmap texel, and where in the world that is.

In: a triangulated Blender mesh with lightmap coordinates, the page of each triangle. Out: per page, triangle numbers.

Row 0 is on top, as in the pages; Blender's v runs up. Where triangles overlap in the lightmap, the last one counts.
"""

import numpy


class Raster:
    """Triangles in the lightmap and in the world."""

    def __init__(self, mesh, uv_layer, triangle_page):
        self.vertices = numpy.empty((len(mesh.vertices), 3), numpy.float32)
        mesh.vertices.foreach_get("co", self.vertices.ravel())
        corners = numpy.empty(len(mesh.loops), numpy.int32)
        mesh.loops.foreach_get("vertex_index", corners)
        self.corners = corners.reshape(-1, 3)
        uv = numpy.empty((len(mesh.loops), 2), numpy.float32)
        mesh.uv_layers[uv_layer].uv.foreach_get("vector", uv.ravel())
        self.uv = uv.reshape(-1, 3, 2)
        self.triangle_page = triangle_page

    def with_page(self):
        """Numbers of the triangles that have a page."""
        return numpy.nonzero(self.triangle_page >= 0)[0]

    def texels(self, i, size):
        """Columns and rows whose centres lie in triangle `i` on a page of this width and height; barycentric weights."""
        width, height = size
        flat = numpy.stack([self.uv[i, :, 0] * width, (1.0 - self.uv[i, :, 1]) * height], axis=1).astype(numpy.float64)
        points, weights = points_inside(flat)
        x, y = numpy.floor(points).astype(int).T
        keep = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        return x[keep], y[keep], weights[keep]

    def triangles(self, sizes):
        """The triangle under each texel of pages of these widths and heights, −1 where there is none."""
        found = [numpy.full(size[::-1], -1, numpy.int32) for size in sizes]
        for i in self.with_page():
            page = self.triangle_page[i]
            x, y, _ = self.texels(i, sizes[page])
            found[page][y, x] = i
        return found

    def place(self, i, weights):
        """World positions [m] in Blender's axes of points on triangle `i`."""
        return weights @ self.vertices[self.corners[i]]


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
