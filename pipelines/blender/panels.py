"""Reads lightmap pages and draws the picture of a difference with Blender alone: ours, Cycles, ours − Cycles.

In: pages as height × width × 3, masks of what was compared. Out: a PNG, page under page, with a legend of its colours.

Light is shown tone-mapped, with the same white for both sides. The difference is that of the means of the channels,
relative to the mean of the reference over all texels; red where ours is brighter, blue where it is darker.

Labels need Blender 5.0 (`blf.bind_imbuf`); before it the picture has none, and the legend is told on stdout alone.
"""

import os
import tempfile

import blf
import bpy
import numpy

from pictures import difference, enlarged, tone_mapped

# The difference at the ends of the scale, relative to the mean.
SCALE = 0.2
# Least width of a panel, heights of the title and the legend [px].
PANEL, TITLE, LEGEND, GAP = 320, 26, 50, 8
FONT = 14.0
BACKGROUND, INK = 0.15, 0.9


def read_page(path):
    """Pixels of an EXR as height × width × 4 floats, row 0 on top, values as stored."""
    if not os.path.isfile(path):
        raise OSError(f"{path}: the file does not exist")
    try:
        image = bpy.data.images.load(str(path))
    except RuntimeError as error:
        raise OSError(f"{path}: {error}") from None
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "CHANNEL_PACKED"
    pixels = pixels_of(image)
    bpy.data.images.remove(image)
    return pixels


def pixels_of(image):
    width, height = image.size
    if width * height == 0:
        raise OSError(f"{image.filepath}: Blender cannot read it")
    pixels = numpy.empty(width * height * 4, numpy.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)[::-1]


def write_png(path, rgb):
    """Display-encoded values in [0, 1] as an 8-bit PNG."""
    height, width, _ = rgb.shape
    image = bpy.data.images.new("texelwalk picture", width, height, alpha=False, is_data=True)
    pixels = numpy.ones((height, width, 4), numpy.float32)
    pixels[..., :3] = numpy.clip(rgb, 0.0, 1.0)[::-1]
    image.pixels.foreach_set(pixels.ravel())
    image.file_format, image.filepath_raw = "PNG", str(path)
    try:
        image.save()
    except RuntimeError as error:
        raise OSError(f"{path}: cannot be written: {error}") from None
    finally:
        bpy.data.images.remove(image)


def picture(pages):
    """`pages`: list of (title, ours, reference, mask). Returns display values."""
    masked = numpy.concatenate([reference[mask] for _, _, reference, mask in pages])
    white = float(numpy.percentile(masked, 95)) if masked.size else 1.0
    mean = float(masked.mean()) if masked.size else 1.0
    rows = [row(*page, white or 1.0, mean or 1.0) for page in pages]
    width = max(r.shape[1] for r in rows)
    return numpy.concatenate([padded(r, width) for r in [*rows, legend(width, mean)]], axis=0)


def row(title, ours, reference, mask, white, mean):
    """Three panels with their titles."""
    factor = max(1, -(-PANEL // ours.shape[1]))
    show = lambda rgb: enlarged(tone_mapped(numpy.where(mask[..., None], rgb, 0.0), white), factor)  # noqa: E731
    panels = [(f"{title}: texelwalk", show(ours)), ("Cycles", show(reference)),
              ("texelwalk − Cycles", enlarged(difference(ours, reference, mask, SCALE * mean), factor))]
    columns = []
    for name, pixels in panels:
        head = written(blank(TITLE, pixels.shape[1]), name, 2, 8)
        columns += [numpy.concatenate([head, pixels], axis=0), blank(TITLE + pixels.shape[0], GAP)]
    joined = numpy.concatenate(columns[:-1], axis=1)
    return numpy.concatenate([joined, blank(GAP, joined.shape[1])], axis=0)


def legend(width, mean):
    """The scale of the difference in colour, with its ends and its middle in figures."""
    bar = max(60, width // 3)
    ramp = numpy.broadcast_to(numpy.linspace(-1.0, 1.0, bar)[None, :, None], (14, bar, 3))
    colors = difference(ramp, numpy.zeros_like(ramp), numpy.ones(ramp.shape[:2], bool), 1.0)
    left = max(0, (width - bar) // 2)
    pixels = blank(LEGEND, width)
    pixels[4:18, left : left + bar] = colors[:, : width - left]
    texts = (f"−{100 * SCALE:.0f} % of the mean", "equal", f"+{100 * SCALE:.0f} % ({SCALE * mean:.3g})")
    for place, text in zip((0.0, 0.5, 1.0), texts):
        extent = measured(text)
        at = min(max(0, int(left + place * bar - extent / 2)), max(0, width - extent))
        pixels = written(pixels, text, at, 12)
    return pixels


def blank(height, width):
    return numpy.full((height, width, 3), BACKGROUND)


def padded(pixels, width):
    return numpy.concatenate([pixels, blank(pixels.shape[0], width - pixels.shape[1])], axis=1)


def measured(text):
    """Width of a text [px]."""
    blf.size(0, FONT)
    return int(blf.dimensions(0, text)[0]) + 1


def written(pixels, text, x, y):
    """Pixels with a text whose base line starts `x` from the left and `y` from the bottom."""
    if not hasattr(blf, "bind_imbuf"):
        return pixels
    import imbuf

    height, width, _ = pixels.shape
    strip = imbuf.new((width, height))
    blf.size(0, FONT)
    with blf.bind_imbuf(0, strip):
        blf.position(0, x, y, 0)
        blf.color(0, 1.0, 1.0, 1.0, 1.0)
        blf.draw_buffer(0, text)
    handle, path = tempfile.mkstemp(suffix=".png")
    os.close(handle)
    try:
        imbuf.write(strip, filepath=path)
        image = bpy.data.images.load(path)
        image.colorspace_settings.name = "Non-Color"
        image.alpha_mode = "CHANNEL_PACKED"
        cover = pixels_of(image)[..., 3:]
        bpy.data.images.remove(image)
    finally:
        os.unlink(path)
    return pixels * (1.0 - cover) + INK * cover
