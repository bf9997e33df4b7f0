"""Blender's importer keeps light at vertices: `_LIGHTMAP` of baked files, bit for bit.

In: glTF or GLB files that were baked with `--target vertex`. Out: a table on stdout; exit code 1 if a value in Blender is
not the file's. The importer joins the primitives of a mesh and drops vertices that no triangle uses; both is done here as
well. Meshes are compared whatever their order.
"""

import argparse
import sys

import environment

environment.enter()

import bpy  # noqa: E402 (the environment comes first)
import numpy  # noqa: E402

from gltf_file import GltfFile, index  # noqa: E402

NAME = "_LIGHTMAP"


def of_file(path):
    """Used vertices' light of each node, primitives in order, as bytes."""
    gltf = GltfFile(path)
    nodes = {}
    for node, number, light in gltf.vertex_light():
        mesh = gltf.json["meshes"][index(gltf.json["nodes"][node]["mesh"])]
        used = numpy.unique(gltf.corners(mesh["primitives"][number]))
        nodes.setdefault(node, []).append(light[used])
    return sorted(numpy.concatenate(parts).astype("<f4").tobytes() for parts in nodes.values())


def of_blender(path):
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing, do_unlink=True)
    bpy.ops.import_scene.gltf(filepath=path, loglevel=40)
    found = []
    for thing in bpy.data.objects:
        attribute = thing.data.attributes.get(NAME) if thing.type == "MESH" else None
        if attribute is not None:
            values = numpy.empty(3 * len(attribute.data), numpy.float32)
            attribute.data.foreach_get("vector", values)
            found.append(values.tobytes())
    return sorted(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    bad = 0
    for path in parser.parse_args().files:
        theirs, ours = of_file(path), of_blender(path)
        same = bool(theirs) and ours == theirs
        bad += not same
        count = sum(map(len, theirs)) // 12
        print(f"{count:>9} vertices of {len(theirs)} nodes {'as in the file' if same else 'DIFFER in Blender'}  {path}")
    if bad:
        sys.stderr.write(f"error: {bad} file(s) do not arrive in Blender as they are\n")
        sys.exit(1)


if __name__ == "__main__":
    main()
