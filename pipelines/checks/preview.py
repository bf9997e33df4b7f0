"""Blender shows the document of --preview-gltf as it is meant: the EXR's own numbers, on the lightmap's coordinates.

In: the preview and the EXR pages that it has to show. Out: a table on stdout; exit code 1 when Blender's importer ends up
with other pixels, converts them, or puts them on other coordinates than TEXCOORD_1 (`UVMap.001`).
"""

import argparse
import sys
from pathlib import Path

import environment

environment.enter()

import bpy  # noqa: E402 (the environment comes first)
import numpy  # noqa: E402

from pictures import read_exr  # noqa: E402

LINEAR = "Linear Rec.709"
LIGHTMAP_LAYER = "UVMap.001"


def imported(path):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(path))


def shown(image):
    """Pixels of a Blender image, row 0 on top."""
    width, height = image.size
    found = numpy.empty(width * height * image.channels, numpy.float32)
    image.pixels.foreach_get(found)
    return found.reshape(height, width, image.channels)[::-1]


def nodes_of(image):
    """Texture nodes that show an image, with the name of the coordinates that they read."""
    for material in bpy.data.materials:
        tree = material.node_tree
        for node in tree.nodes if tree else []:
            if node.type == "TEX_IMAGE" and node.image == image:
                links = node.inputs["Vector"].links
                source = links[0].from_node if links else None
                yield material.name, getattr(source, "uv_map", None), bool(node.outputs["Color"].links)


def faults_of(page):
    images = [i for i in bpy.data.images if Path(bpy.path.abspath(i.filepath)).name == page.name]
    if len(images) != 1:
        return [f"{len(images)} images show it, not 1"]
    image, expected = images[0], read_exr(page)
    faults = []
    if image.colorspace_settings.name != LINEAR:
        faults.append(f"colour space is {image.colorspace_settings.name}, not {LINEAR}")
    found = shown(image)
    if found.shape != expected.shape:
        faults.append(f"{found.shape} pixels instead of {expected.shape}")
    elif not numpy.array_equal(found[..., :3], expected[..., :3]):
        worst = numpy.abs(found[..., :3] - expected[..., :3]).max()
        faults.append(f"pixels differ by up to {worst:.4g}")
    nodes = list(nodes_of(image))
    if not nodes:
        faults.append("no material shows it")
    for material, layer, used in nodes:
        if layer != LIGHTMAP_LAYER or not used:
            faults.append(f"material {material} reads it at {layer}, not {LIGHTMAP_LAYER}, or does not use it")
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("preview", type=Path)
    parser.add_argument("pages", type=Path, nargs="+")
    arguments = parser.parse_args()
    imported(arguments.preview)
    bad = 0
    for page in arguments.pages:
        faults = faults_of(page)
        print(f"{'FAULT' if faults else 'ok':<6} {page}")
        for fault in faults:
            print(f"    {fault}")
        bad += len(faults)
    if bad:
        sys.stderr.write(f"error: {bad} fault(s) in what Blender shows\n")
        sys.exit(1)


if __name__ == "__main__":
    main()
