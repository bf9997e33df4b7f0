"""Bakes E/π by Blender's Cycles, without anything that biases it, and compares arrays of texels.

In: the object and images that `cycles_scene` built. Out: pixels, row 0 on top; figures of a comparison.

Compared is Cycles' DIFFUSE pass without colour (direct and indirect). Two bakes with different seeds give the reference,
their mean, and its variance, a quarter of their mean squared difference; that is subtracted from the mean squared error
("net"; the noise of what is compared is not).

A texel of texelwalk is the mean over its visible surface. Cycles samples a texel only on the triangle under its centre,
and counts what is buried in other solids. So Cycles bakes on a finer raster, and the reference for a texel is the mean of
its fine texels that are not buried (`buried.py`).
"""

import contextlib
import math
import os
import sys

import numpy

# Marks texels that Cycles does not write.
UNTOUCHED = -1.0
# The name cycles_scene gives to the coordinates of the lightmap.
LIGHTMAP_UV = "lightmap"


@contextlib.contextmanager
def quiet():
    """Keeps what Blender prints to stdout, from Python and from C, out of our table."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)


def set_up(samples, threads):
    """Makes Cycles trace paths without a bias: no limit that is felt, no clamp, no filter, no adaptive number of samples."""
    import bpy

    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    settings = scene.cycles
    settings.device, settings.samples = "CPU", samples
    settings.use_adaptive_sampling = settings.use_denoising = False
    # No limit that biases: bounces, clamps, filters, and the default that drops dim lights.
    settings.max_bounces = settings.diffuse_bounces = settings.transmission_bounces = 128
    settings.transparent_max_bounces = 256
    settings.sample_clamp_direct = settings.sample_clamp_indirect = 0.0
    settings.blur_glossy = settings.light_sampling_threshold = 0.0
    return scene


def bake(baked, pages, samples, seed, threads):
    """One bake of all pages; returns their pixels, row 0 on top, UNTOUCHED where Cycles wrote nothing."""
    import bpy

    scene = set_up(samples, threads)
    scene.cycles.seed = seed
    for _, image in pages:
        width, height = image.size
        image.pixels.foreach_set(numpy.full(width * height * 4, UNTOUCHED, numpy.float32))
    for thing in bpy.data.objects:
        thing.select_set(thing == baked)
    bpy.context.view_layer.objects.active = baked
    baked.data.uv_layers.active = baked.data.uv_layers[LIGHTMAP_UV]
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, uv_layer=LIGHTMAP_UV, margin=0, use_clear=False)
    result = []
    for _, image in pages:
        width, height = image.size
        pixels = numpy.empty(width * height * 4, numpy.float32)
        image.pixels.foreach_get(pixels)
        result.append(pixels.reshape(height, width, 4)[::-1, :, :3].astype(numpy.float64))
    return result


def figures(ours, first, second, mask):
    """Ratio of means, raw and net NRMSE, Cycles' own noise, and how many texels, over a mask."""
    reference = (first + second) / 2.0
    mean = reference[mask].mean()
    squared = ((ours - reference)[mask] ** 2).mean()
    noise = ((first - second)[mask] ** 2).mean() / 4.0
    mean = max(mean, 1e-30)
    return {
        "texels": int(mask.sum()),
        "mean_ratio": ours[mask].mean() / mean,
        "nrmse_raw": math.sqrt(squared) / mean,
        "nrmse_net": math.sqrt(max(0.0, squared - noise)) / mean,
        "cycles_noise": math.sqrt(noise) / mean,
    }


def blocks(pixels, n):
    """An image as rows × n × columns × n × channels; what is left over at the ends is dropped."""
    height, width = (size - size % n for size in pixels.shape[:2])
    return pixels[:height, :width].reshape(height // n, n, width // n, n, *pixels.shape[2:])


def mean_over(pixels, mask, n):
    """Means over the masked pixels of blocks of n × n; 0 where there are none."""
    total = blocks(numpy.where(mask[..., None], pixels, 0.0), n).sum(axis=(1, 3))
    return total / numpy.maximum(blocks(mask, n).sum(axis=(1, 3)), 1)[..., None]


def tile_means(arrays, masks, tile):
    """Means over the masked texels of square tiles of all pages that are at least half masked: tiles × RGB."""
    full = [blocks(mask, tile).sum(axis=(1, 3)) >= tile * tile / 2 for mask in masks]
    return numpy.concatenate([mean_over(*both, tile)[keep] for *both, keep in zip(arrays, masks, full)])
