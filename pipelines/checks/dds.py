"""Compares pictures of DDS files with what texelwalk read of them: dds.py FILE.dds PIXELS [FILE.dds PIXELS …].

PIXELS holds the bytes of 8-bit RGBA, top row first, alpha apart from colour. OpenImageIO decodes the file. Every byte must
be the same, up to --tolerance (1: the two round the means of two colours otherwise).
"""

import argparse
import pathlib
import sys

import environment

environment.enter()

import numpy  # noqa: E402 (the environment comes first)
import OpenImageIO as oiio  # noqa: E402


def read(path):
    """Pixels of a file, (height, width, 4)."""
    how = oiio.ImageSpec()
    how["oiio:UnassociatedAlpha"] = 1
    source = oiio.ImageInput.open(path, how)
    if source is None:
        sys.exit(f"error: {path}: {oiio.geterror()}")
    spec = source.spec()
    pixels = numpy.asarray(source.read_image(oiio.UINT8)).reshape(spec.height, spec.width, spec.nchannels)
    source.close()
    if spec.nchannels == 3:
        pixels = numpy.dstack([pixels, numpy.full(pixels.shape[:2], 255, numpy.uint8)])
    return pixels


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--tolerance", type=int, default=1)
    arguments = parser.parse_args()
    found = []
    for path, ours in zip(arguments.files[::2], arguments.files[1::2]):
        expected = read(path).astype(int)
        pixels = numpy.frombuffer(pathlib.Path(ours).read_bytes(), numpy.uint8)
        if pixels.size != expected.size:
            found.append(f"{path}: {pixels.size} bytes, not {expected.size}")
            continue
        apart = abs(pixels.astype(int).reshape(expected.shape) - expected)
        print(f"{path}: {expected.shape[1]} x {expected.shape[0]}, at most {apart.max()} apart, {(apart > 0).mean():.2%} of the bytes")
        if apart.max() > arguments.tolerance:
            found.append(f"{path}: {apart.max()} apart")
    for fault in found:
        print(f"error: {fault}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
