"""Options of `texelwalk bake` that say what shines besides what is in the file, for scripts that light a scene again.

In: a command line, and the settings that a baked page carries. Out: arguments of `cycles_light.Light`.

A page holds the settings of its bake as JSON in the EXR attribute `texelwalk.settings`; an option that is given wins.
"""

import argparse
import json
import struct
from pathlib import Path

NAMES = ("sky", "sky_horizon", "sky_ground", "sun_angle", "light_radius", "environment", "environment_intensity",
         "environment_rotation")


def triple(text):
    """A colour R,G,B, or one number for all three."""
    try:
        values = tuple(float(x) for x in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (1, 3):
        raise argparse.ArgumentTypeError(f"'{text}' is neither one number nor R,G,B")
    return values * 3 if len(values) == 1 else values


def add(parser):
    """Adds the options to a command line."""
    group = parser.add_argument_group("light, as given to `texelwalk bake`")
    group.add_argument("--sky", type=triple, metavar="R,G,B", help="radiance of the sky at the zenith [cd/m2]")
    group.add_argument("--sky-horizon", type=triple, metavar="R,G,B")
    group.add_argument("--sky-ground", type=triple, metavar="R,G,B")
    group.add_argument("--sun-angle", type=float, metavar="DEGREES")
    group.add_argument("--light-radius", type=float, metavar="M")
    group.add_argument("--environment", metavar="FILE")
    group.add_argument("--environment-intensity", type=float, metavar="X")
    group.add_argument("--environment-rotation", type=float, metavar="DEGREES")


def light(arguments, settings):
    """Arguments of `cycles_light.Light`: options, else settings of the bake, else what `bake` does without."""
    given = {name: getattr(arguments, name) for name in NAMES}
    choose = lambda name, other: given[name] if given[name] is not None else settings.get(name.replace("_", "-"), other)  # noqa: E731
    baked = [tuple(c) for c in settings.get("sky") or [(0.0, 0.0, 0.0)] * 3]
    if any(given[name] is not None for name in NAMES[:3]):
        # As `bake` fills up: the horizon is as the zenith, the ground as the horizon.
        zenith = given["sky"] or (0.0, 0.0, 0.0)
        horizon = given["sky_horizon"] or zenith
        baked = [zenith, horizon, given["sky_ground"] or horizon]
    return {
        "sky": tuple(baked),
        "sun_angle_degrees": choose("sun_angle", None),
        "light_radius": choose("light_radius", None),
        "environment": choose("environment", None),
        "environment_intensity": choose("environment_intensity", 1.0),
        "environment_rotation_degrees": choose("environment_rotation", 0.0),
    }


def settings_of(page):
    """Settings of the bake that wrote an EXR page; empty where it says nothing."""
    return json.loads(attributes(page).get("texelwalk.settings", "{}"))


def attributes(path):
    """String attributes of the header of an EXR file of one part (OpenEXR file layout, openexr.com)."""
    data = Path(path).read_bytes()
    if data[:4] != b"\x76\x2f\x31\x01":
        raise ValueError(f"{path}: not an EXR file")
    found, at = {}, 8
    try:
        while data[at] != 0:
            name, kind = names(data, at)
            at += len(name) + len(kind) + 2
            size = struct.unpack_from("<i", data, at)[0]
            if kind == b"string":
                found[name.decode()] = data[at + 4 : at + 4 + size].decode()
            at += 4 + size
    except (IndexError, ValueError, struct.error):
        raise ValueError(f"{path}: its EXR header is broken") from None
    return found


def names(data, at):
    """Name and type of the attribute at an offset, each ended by a zero byte."""
    end = data.index(b"\0", at)
    return data[at:end], data[end + 1 : data.index(b"\0", end + 1)]
