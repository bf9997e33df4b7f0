"""Reads lightmap pages, and draws small PNG pictures of them and of their differences for people to look at.

OpenImageIO is loaded where files are read and written only: the rest also runs inside Blender, which may lack it.
"""

import numpy


def read_exr(path):
    """Pixels of an image file as height × width × channels floats, row 0 on top."""
    import OpenImageIO as oiio

    image = oiio.ImageBuf(str(path))
    if not image.initialized or image.has_error:
        raise OSError(f"{path}: {image.geterror()}")
    return image.get_pixels("float")


def interior(charted):
    """Texels whose eight neighbours are charted too: whole squares, all of the same area."""
    padded = numpy.pad(charted, 1)
    height, width = charted.shape
    return numpy.logical_and.reduce([padded[y : y + height, x : x + width] for y in range(3) for x in range(3)])


def write_png(path, rgb):
    """Display-encoded values in [0, 1] as an 8-bit PNG."""
    import OpenImageIO as oiio

    pixels = numpy.ascontiguousarray((numpy.clip(rgb, 0.0, 1.0) * 255.0 + 0.5).astype(numpy.uint8))
    height, width, channels = pixels.shape
    output = oiio.ImageOutput.create(str(path))
    if output is None or not output.open(str(path), oiio.ImageSpec(width, height, channels, "uint8")):
        raise OSError(f"{path}: cannot be written: {oiio.geterror()}")
    output.write_image(pixels)
    output.close()


def tone_mapped(rgb, white):
    """Linear light for a display: x/(x + white/2), then the sRGB curve; the same `white` makes pictures comparable."""
    x = numpy.maximum(rgb, 0.0)
    x = x / (x + 0.5 * white) * 1.5
    return numpy.where(x <= 0.0031308, 12.92 * x, 1.055 * numpy.maximum(x, 1e-9) ** (1.0 / 2.4) - 0.055)


def difference(ours, theirs, mask, scale):
    """Signed difference of the means of the channels: red where ours is brighter, blue where it is darker."""
    d = numpy.where(mask, (ours - theirs).mean(axis=2) / scale, 0.0)
    d = numpy.clip(d, -1.0, 1.0)[..., None]
    white = numpy.array([1.0, 1.0, 1.0])
    picture = numpy.where(d > 0, white + d * (numpy.array([1.0, 0.0, 0.0]) - white), white - d * (numpy.array([0.0, 0.2, 1.0]) - white))
    return numpy.where(mask[..., None], picture, 0.5)


def enlarged(rgb, factor):
    return numpy.repeat(numpy.repeat(rgb, factor, axis=0), factor, axis=1)
