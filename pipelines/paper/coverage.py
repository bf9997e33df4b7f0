"""How much of each lightmap texel is charted: the area of its patch as a share of a whole texel.

In: a baked glTF. Out: per page, height × width shares in [0, 1], row 0 on top. Charts have one density, so shares of texels
are proportional to areas on the surface.

Needed because patches here are cut by the borders of charts, while the paper's are whole. Shares come from 8 × 8 points per
texel; a sliver that holds none of them has share 0.
"""

import numpy

from gltf_file import GltfFile, index

POINTS = 8


def coverage(path, sizes):
    """Shares for pages of the given (height, width), in the order of the manifest."""
    gltf = GltfFile(path)
    page_of = {index(page["texture"]): k for k, page in enumerate(gltf.lightmap_pages())}
    hit = [numpy.zeros((h * POINTS, w * POINTS), bool) for h, w in sizes]
    for node in gltf.json["nodes"]:
        for primitive in gltf.json["meshes"][index(node["mesh"])]["primitives"] if "mesh" in node else ():
            material = gltf.json["materials"][index(primitive["material"])] if "material" in primitive else {}
            lightmap = material.get("extensions", {}).get("MOZ_lightmap")
            if not lightmap:
                continue
            uv = gltf.accessor(index(primitive["attributes"][f"TEXCOORD_{index(lightmap.get('texCoord', 0))}"]))
            target = hit[page_of[index(lightmap["index"])]]
            for triangle in uv[gltf.corners(primitive)].reshape(-1, 3, 2).astype(numpy.float64):
                mark(target, triangle * (target.shape[1], target.shape[0]))
    return [m.reshape(h, POINTS, w, POINTS).mean(axis=(1, 3)) for m, (h, w) in zip(hit, sizes)]


def mark(target, triangle):
    """Sets the points inside a triangle given in points; shared edges count as inside both."""
    low = numpy.maximum(numpy.floor(triangle.min(axis=0) - 0.5).astype(int), 0)
    high = numpy.minimum(numpy.ceil(triangle.max(axis=0) + 0.5).astype(int), target.shape[::-1])
    x, y = numpy.meshgrid(numpy.arange(low[0], high[0]) + 0.5, numpy.arange(low[1], high[1]) + 0.5)
    edges = [side(triangle[i], triangle[(i + 1) % 3], x, y) for i in range(3)]
    # Rounding of the coordinates must not open gaps between neighbouring triangles.
    slack = 1e-6 * float(numpy.ptp(triangle, axis=0).max())
    inside = numpy.logical_or(numpy.logical_and.reduce([e >= -slack for e in edges]), numpy.logical_and.reduce([e <= slack for e in edges]))
    target[low[1] : high[1], low[0] : high[0]] |= inside


def side(a, b, x, y):
    return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
