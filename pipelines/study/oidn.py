"""Calls Open Image Denoise, the denoiser of Cycles, through its C interface.

In: an image as height × width × 3 floats. Out: the denoised one. Nothing of it is ours. Two libraries, each with its
trained weights: the one that comes with Blender, and its authors' own release, which alone has the weights for lightmaps.

Why not through Blender: `cycles.use_denoising` has no effect on bakes (5.0.1 gives the same bits with and without), so
users of Blender denoise the baked image afterwards, with this library.
"""

import ctypes

import numpy

import environment
from study_venv import VENV

CPU, FLOAT3 = 1, 3
# RTLightmap is the library's own filter for baked light; RT is the one for pictures, which can be guided by normals.
FILTERS = ("RTLightmap", "RT", "RT+normal")


def library(kind):
    packages = VENV.glob("lib/python*/site-packages/pyoidn/oidn/lib") if kind == "RTLightmap" else \
        environment.VENV.glob("lib/python*/site-packages/bpy/lib")
    found = [file for folder in packages for file in folder.glob("libOpenImageDenoise.so.2*")]
    if not found:
        environment.fail(f"no libOpenImageDenoise for {kind}; this script knows the Linux wheels only")
    made = ctypes.CDLL(str(found[0]))
    pointer, text, size = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t
    made.oidnNewDevice.restype, made.oidnNewDevice.argtypes = pointer, [ctypes.c_int]
    made.oidnSetDeviceInt.argtypes = [pointer, text, ctypes.c_int]
    made.oidnSetDeviceBool.argtypes = [pointer, text, ctypes.c_bool]
    made.oidnNewFilter.restype, made.oidnNewFilter.argtypes = pointer, [pointer, text]
    made.oidnSetSharedFilterImage.argtypes = [pointer, text, pointer, ctypes.c_int, size, size, size, size, size]
    made.oidnSetFilterBool.argtypes = [pointer, text, ctypes.c_bool]
    made.oidnGetDeviceError.argtypes = [pointer, ctypes.POINTER(text)]
    for name in ("oidnCommitDevice", "oidnCommitFilter", "oidnExecuteFilter", "oidnReleaseFilter", "oidnReleaseDevice"):
        getattr(made, name).argtypes = [pointer]
    return made


def denoised(rgb, kind, threads, normal=None):
    """The denoised image; `normal` guides the filter `RT+normal`."""
    oidn = library(kind)
    device = oidn.oidnNewDevice(CPU)
    oidn.oidnSetDeviceInt(device, b"numThreads", threads)
    oidn.oidnSetDeviceBool(device, b"setAffinity", False)
    oidn.oidnCommitDevice(device)
    work = oidn.oidnNewFilter(device, kind.split("+")[0].encode())
    images = {"color": numpy.ascontiguousarray(rgb, numpy.float32), "output": numpy.zeros(rgb.shape, numpy.float32)}
    if kind == "RT+normal":
        # The library takes no normals without albedo; ours has been divided out, so it is white.
        images["albedo"] = numpy.ones(rgb.shape, numpy.float32)
        images["normal"] = numpy.ascontiguousarray(normal, numpy.float32)
    height, width, _ = rgb.shape
    for name, image in images.items():
        oidn.oidnSetSharedFilterImage(work, name.encode(), image.ctypes.data, FLOAT3, width, height, 0, 0, 0)
    if kind != "RTLightmap":
        oidn.oidnSetFilterBool(work, b"hdr", True)
        oidn.oidnSetFilterBool(work, b"cleanAux", True)
    oidn.oidnCommitFilter(work)
    oidn.oidnExecuteFilter(work)
    message = ctypes.c_char_p()
    if oidn.oidnGetDeviceError(device, ctypes.byref(message)):
        raise OSError(f"Open Image Denoise: {message.value.decode()}")
    oidn.oidnReleaseFilter(work)
    oidn.oidnReleaseDevice(device)
    return images["output"]


def filled(rgb, known, steps):
    """Unknown texels become the mean of known neighbours, `steps` texels outwards, so that charts do not end in black."""
    rgb, known = numpy.where(known[..., None], rgb, 0.0).astype(numpy.float32), known.copy()
    for _ in range(steps):
        total, count = numpy.zeros_like(rgb), numpy.zeros(known.shape, numpy.float32)
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                from_y, to_y = slice(max(dy, 0), known.shape[0] + min(dy, 0)), slice(max(-dy, 0), known.shape[0] + min(-dy, 0))
                from_x, to_x = slice(max(dx, 0), known.shape[1] + min(dx, 0)), slice(max(-dx, 0), known.shape[1] + min(-dx, 0))
                total[to_y, to_x] += rgb[from_y, from_x]
                count[to_y, to_x] += known[from_y, from_x]
        new = ~known & (count > 0)
        rgb[new] = total[new] / count[new][:, None]
        known |= new
    return rgb
