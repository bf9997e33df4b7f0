"""Compares the charts of texelwalk with those of xatlas and of Blender's Lightmap Pack, on the fixtures.

In: folder for the bakes; options --binary, --density, --triangles. Out: a table on stdout, as Markdown, and the seconds
that a smooth surface of a million triangles takes.

For every scene the same triangles, in world space, are laid out by three programs:

* texelwalk bakes with its default preset and next to no rays; the layout is read from the baked file, the time from its
  report. Once more, without padding (bare), for what padding costs.
* xatlas (charts.py starts itself in the environment of the studies) gets one mesh per primitive, its own defaults, and
  the same density. By default it leaves no texels between charts.
* Blender's Lightmap Pack runs on one mesh with its own defaults, on one square, which is then scaled so that the mean
  density over the surface is the wanted one.

used: area of the surface on the page over the page's area. spread: 95th over 5th percentile of texels per metre over the
area. charts: triangles that hang together on the page; per mesh. Seconds are of charting and packing alone.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[1:1] = [str(HERE.parent / "checks")]

import environment  # noqa: E402 (its folder comes first)

if __name__ == "__main__" and "--xatlas" not in sys.argv:
    environment.enter()

import numpy  # noqa: E402 (the environment comes first)

SCENES = ("cornell/cornell.gltf", "office/office.glb", "room/room.glb", "courtyard/courtyard.gltf", "two-rooms/two-rooms.glb",
          "chairs/chairs.glb", "primitives/primitives.gltf", "freedoom/freedoom-map01.glb")
# A level of a game covers a hundred times the area of a room.
FACTOR = {"freedoom/freedoom-map01.glb": 0.25}
# Rays enough to get files, not for light.
BARE = ("--padding", "0", "--mips", "0")
NO_LIGHT = ("--gather", "0", "--lines-per-texel", "0.01", "--direct-samples", "1", "-q")


class Layout:
    """Triangles in the world [m] and on a page [texels], the mesh of each, and the pages."""

    def __init__(self, world, flat, mesh, pages, size, seconds):
        self.world, self.flat, self.mesh = world, flat, mesh
        self.pages, self.size, self.seconds = pages, size, seconds

    def areas(self):
        sides = self.world[:, 1] - self.world[:, 0], self.world[:, 2] - self.world[:, 0]
        return numpy.linalg.norm(numpy.cross(*sides), axis=1) / 2

    def row(self):
        area = self.areas()
        a, b = self.flat[:, 1] - self.flat[:, 0], self.flat[:, 2] - self.flat[:, 0]
        flat = numpy.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
        real = area > 0
        density = numpy.sqrt(flat[real] / area[real])
        order = numpy.argsort(density)
        share = numpy.cumsum(area[real][order]) / area[real].sum()
        low, high = (density[order][numpy.searchsorted(share, part)] for part in (0.05, 0.95))
        used = flat.sum() / (self.size[0] * self.size[1] * self.pages)
        return used, high / max(low, 1e-9), charts(self.flat, self.mesh) / len(set(self.mesh)), self.pages, self.size, self.seconds


def charts(flat, mesh):
    """Number of sets of triangles that share two corners on the page."""
    corners = numpy.round(flat * 256).astype(numpy.int64)
    parent = list(range(len(flat)))

    def root(i):
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    seen = {}
    for i, triangle in enumerate(corners.tolist()):
        for k in range(3):
            key = (mesh[i], *sorted((tuple(triangle[k]), tuple(triangle[(k + 1) % 3]))))
            parent[root(i)] = root(seen.setdefault(key, i))
    return len({root(i) for i in range(len(flat))})


def matrix(node):
    """A node's transform relative to its parent."""
    if "matrix" in node:
        return numpy.array([float(v) for v in node["matrix"]]).reshape(4, 4).T
    out = numpy.eye(4)
    x, y, z, w = (float(v) for v in node.get("rotation", (0, 0, 0, 1)))
    out[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                   [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                   [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    out[:3, :3] *= numpy.array([float(v) for v in node.get("scale", (1, 1, 1))])
    out[:3, 3] = [float(v) for v in node.get("translation", (0, 0, 0))]
    return out


def baked_layout(path, seconds):
    """The layout of a baked file. Primitives without a page are left out."""
    from gltf_file import GltfFile, index

    gltf = GltfFile(path)
    document = gltf.json
    scene = document["scenes"][index(document.get("scene", 0))]
    pages = scene["extras"]["lightmap"]["pages"]
    size = [index(pages[0]["width"]), index(pages[0]["height"])]
    world, flat, mesh, stack = [], [], [], [(index(n), numpy.eye(4)) for n in scene["nodes"]]
    while stack:
        i, above = stack.pop()
        node = document["nodes"][i]
        here = above @ matrix(node)
        stack += [(index(child), here) for child in node.get("children", [])]
        for primitive in document["meshes"][index(node["mesh"])]["primitives"] if "mesh" in node else []:
            material = document["materials"][index(primitive["material"])] if "material" in primitive else {}
            lightmap = material.get("extensions", {}).get("MOZ_lightmap")
            if not lightmap:
                continue
            corners = gltf.corners(primitive)
            position = gltf.accessor(index(primitive["attributes"]["POSITION"])).astype(float)
            coordinates = gltf.accessor(index(primitive["attributes"]["TEXCOORD_%d" % index(lightmap["texCoord"])])).astype(float)
            page = index(lightmap["index"])
            world.append((position @ here[:3, :3].T + here[:3, 3])[corners].reshape(-1, 3, 3))
            # Pages side by side, so that charts of different pages do not touch.
            flat.append((coordinates * size + (2 * size[0] * page, 0))[corners].reshape(-1, 3, 2))
            mesh += [len(world)] * len(world[-1])
    return Layout(numpy.concatenate(world), numpy.concatenate(flat), mesh, len(pages), size, seconds)


def texelwalk(binary, scene, density, folder, options=()):
    report = folder / "report.json"
    command = [binary, "bake", scene, "-o", f"{folder}/", "--report", report, "--uv", "generate", "--texels-per-meter", str(density),
               *NO_LIGHT, *options]
    environment.run(f"baking {scene}", command)
    stages = json.loads(report.read_text(encoding="utf-8"))["stages"]
    return baked_layout(folder / Path(scene).name, sum(s["seconds"] for s in stages if s["name"] == "atlas"))


def xatlas(layout, density, folder):
    from study_venv import python

    source, target = folder / "triangles.npz", folder / "xatlas.npz"
    numpy.savez(source, world=layout.world, mesh=layout.mesh, density=density)
    environment.run("xatlas", [python(), __file__, "--xatlas", source, target])
    found = numpy.load(target)
    return Layout(layout.world, found["flat"], layout.mesh, int(found["pages"]), found["size"].tolist(), float(found["seconds"]))


def run_xatlas(source, target):
    """In the environment of the studies: lays out what `source` holds."""
    import xatlas as library

    given = numpy.load(source)
    world, mesh, density = given["world"], given["mesh"], float(given["density"])
    start = time.perf_counter()
    atlas = library.Atlas()
    groups = [numpy.flatnonzero(mesh == m) for m in sorted(set(mesh.tolist()))]
    for group in groups:
        corners = world[group].reshape(-1, 3).astype(numpy.float32)
        positions, indices = numpy.unique(corners, axis=0, return_inverse=True)
        atlas.add_mesh(positions, indices.reshape(-1, 3).astype(numpy.uint32))
    pack = library.PackOptions()
    pack.texels_per_unit = density
    atlas.generate(library.ChartOptions(), pack)
    seconds = time.perf_counter() - start
    flat = numpy.zeros((len(world), 3, 2))
    size, count = numpy.array([atlas.width, atlas.height]), atlas.atlas_count
    for m, group in enumerate(groups):
        _, indices, coordinates = atlas[m]
        flat[group] = coordinates.astype(float)[indices] * size
    numpy.savez(target, flat=flat, pages=count, size=size, seconds=seconds)


@contextlib.contextmanager
def quiet():
    """What Blender prints as it goes does not get between the rows."""
    sys.stdout.flush()
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)


def blender(layout, density):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("all")
    points = layout.world.reshape(-1, 3)
    mesh.from_pydata(points.tolist(), [], numpy.arange(len(points)).reshape(-1, 3).tolist())
    thing = bpy.data.objects.new("all", mesh)
    bpy.context.collection.objects.link(thing)
    bpy.context.view_layer.objects.active = thing
    thing.select_set(True)
    start = time.perf_counter()
    with quiet():
        bpy.ops.uv.lightmap_pack(PREF_CONTEXT="ALL_FACES", PREF_NEW_UVLAYER=True)
    seconds = time.perf_counter() - start
    flat = numpy.zeros(len(points) * 2)
    mesh.uv_layers[-1].data.foreach_get("uv", flat)
    flat = flat.reshape(-1, 3, 2)
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    on_page = numpy.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2
    side = density * numpy.sqrt(layout.areas().sum() / on_page)
    return Layout(layout.world, flat * side, layout.mesh, 1, [side, side], seconds)


def million(binary, folder, triangles):
    """Seconds for a smooth closed surface with bumps of many sizes."""
    rows = int((triangles / 4) ** 0.5)
    u, v = numpy.meshgrid(numpy.arange(2 * rows) / (2 * rows), (numpy.arange(rows + 1)) / rows)
    theta, phi = 2 * numpy.pi * u, numpy.pi * v
    height = 3 + sum(numpy.sin(k * theta + k) * numpy.sin((k + 1) * phi) / k for k in (2, 5, 11, 23))
    position = numpy.stack([height * numpy.sin(phi) * numpy.cos(theta), height * numpy.cos(phi), -height * numpy.sin(phi) * numpy.sin(theta)], axis=2)
    i, j = numpy.meshgrid(numpy.arange(rows), numpy.arange(2 * rows), indexing="ij")
    a, b = i * 2 * rows + j, i * 2 * rows + (j + 1) % (2 * rows)
    faces = numpy.stack([a, a + 2 * rows, b + 2 * rows, a, b + 2 * rows, b], axis=2).reshape(-1).astype(numpy.uint32)
    points = position.reshape(-1, 3).astype(numpy.float32)
    (folder / "million.bin").write_bytes(points.tobytes() + faces.tobytes())
    views = [{"buffer": 0, "byteLength": points.nbytes}, {"buffer": 0, "byteOffset": points.nbytes, "byteLength": faces.nbytes}]
    accessors = [{"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3", "min": points.min(0).tolist(), "max": points.max(0).tolist()},
                 {"bufferView": 1, "componentType": 5125, "count": len(faces), "type": "SCALAR"}]
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}], "accessors": accessors,
                "bufferViews": views, "buffers": [{"uri": "million.bin", "byteLength": points.nbytes + faces.nbytes}]}
    (folder / "million.gltf").write_text(json.dumps(document), encoding="utf-8")
    start = time.perf_counter()
    found = json.loads(subprocess.run([binary, "inspect", folder / "million.gltf", "--texels-per-meter", "32", "--json"],
                                      capture_output=True, check=True, text=True).stdout)
    print(f"{len(faces) // 3} triangles: {found['charts']} charts in {time.perf_counter() - start:.1f} s with loading, "
          f"{found['pages']} page(s) of {found['page_size']}, {found['utilization']:.0%} touched")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--binary", default=environment.ROOT / "target/release/texelwalk")
    parser.add_argument("--density", default="16")
    parser.add_argument("--scene", choices=[Path(s).parent.name for s in SCENES], help="this one alone")
    parser.add_argument("--triangles", type=int, default=1_000_000, help="of the smooth surface; 0 leaves it out")
    arguments = parser.parse_args()
    print("| scene | triangles | by | used | spread | charts per mesh | pages | seconds |\n|---|---|---|---|---|---|---|---|")
    for scene in (s for s in SCENES if arguments.scene in (None, Path(s).parent.name)):
        folder = arguments.out / Path(scene).stem
        folder.mkdir(parents=True, exist_ok=True)
        source = str(environment.ROOT / "fixtures" / scene)
        density = float(arguments.density) * FACTOR.get(scene, 1.0)
        ours, bare = (texelwalk(arguments.binary, source, density, folder, options) for options in ((), BARE))
        layouts = {"texelwalk": ours, "texelwalk, bare": bare, "xatlas": xatlas(ours, density, folder), "Lightmap Pack": blender(ours, density)}
        for name, layout in layouts.items():
            used, spread, per_mesh, pages, size, seconds = layout.row()
            page = f"{pages} of {size[0]:.0f} × {size[1]:.0f}"
            print(f"| {Path(scene).parent} | {len(ours.world)} | {name} | {used:.0%} | {spread:.2f} | {per_mesh:.1f} | {page} | {seconds:.2f} |",
                  flush=True)
    if arguments.triangles:
        million(arguments.binary, arguments.out, arguments.triangles)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--xatlas"]:
        run_xatlas(*sys.argv[2:])
    else:
        main()
