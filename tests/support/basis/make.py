"""Makes the KTX2 files of this folder, and beside each a PNG with what the reference transcoder reads in it.

In: nothing. Out: NAME.ktx2 and NAME.png in this folder. The encoder is that of Basis Universal, as the Python package alktx2 0.1.7
has it; the decoder is its transcoder, as the package opengl_basisu 0.1.0a2 has it. Run it where these are installed:
`pip install alktx2==0.1.7 opengl_basisu==0.1.0a2 Pillow`. The tests read the files only.
"""

from pathlib import Path

import alktx2
import numpy
import opengl_basisu
from PIL import Image

FOLDER = Path(__file__).parent
# No multiple of the blocks' four texels.
WIDTH, HEIGHT = 30, 21


def picture(alpha):
    """Gradients, a sharp edge, and noise; with `alpha` a hole."""
    y, x = numpy.mgrid[0:HEIGHT, 0:WIDTH]
    noise = numpy.random.default_rng(7).integers(0, 40, (HEIGHT, WIDTH))
    red, green = 255 * x // (WIDTH - 1), 255 * y // (HEIGHT - 1)
    blue = numpy.where(x > y, 200, 20) + noise
    opacity = numpy.where((x - 12) ** 2 + (y - 10) ** 2 < 36, 30, 255) if alpha else numpy.full_like(x, 255)
    return numpy.stack([red, green, blue, opacity], axis=-1).astype(numpy.uint8)


def make(name, alpha, **options):
    pixels = picture(alpha).tobytes()
    data = alktx2.encode_raw_rgba_to_ktx2(pixels, WIDTH, HEIGHT, alpha, threads=1, mipmaps=True, **options)
    (FOLDER / f"{name}.ktx2").write_bytes(data)
    texture = opengl_basisu.open(data)
    pixels = texture.transcode("rgba8").data.reshape(HEIGHT, WIDTH, 4)
    Image.fromarray(pixels).save(FOLDER / f"{name}.png", optimize=True)
    print(f"{name}: {len(data)} bytes, {texture.codec}, alpha {texture.has_alpha}")


if __name__ == "__main__":
    make("etc1s", False, codec="etc1s", quality=60)
    make("etc1s-alpha", True, codec="etc1s", quality=60)
    make("uastc", True, codec="uastc")
    make("uastc-zstd", False, codec="uastc", zstd_supercompression_level=9)
