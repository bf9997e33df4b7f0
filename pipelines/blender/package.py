"""Writes the archive that Blender installs as an add-on: `python3 pipelines/blender/package.py texelwalk-blender.zip`.

In: the scripts of this folder and what they use of `pipelines/checks`. Out: a zip with one folder, the same bytes every
time. Standard library only.
"""

import sys
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
CHECKS = HERE.parent / "checks"
NAME = "texelwalk_blender"
SCRIPTS = ("view.py", "verify.py", "verdict.py", "panels.py")
MODULES = ("buried.py", "cycles_bake.py", "cycles_light.py", "cycles_scene.py", "gltf_file.py", "gltf_nodes.py", "gltf_optics.py",
           "light_options.py", "pictures.py", "texel_raster.py")


def members():
    """(name in the archive, file)."""
    yield "__init__.py", HERE / "addon.py"
    yield from ((name, HERE / name) for name in SCRIPTS)
    yield from ((f"checks/{name}", CHECKS / name) for name in MODULES)


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.stderr.write(f"usage: {Path(__file__).name} OUT.zip\n")
        sys.exit(2)
    try:
        with zipfile.ZipFile(sys.argv[1], "w", zipfile.ZIP_DEFLATED) as archive:
            for name, path in members():
                # A fixed date: the archive depends on the scripts alone.
                archive.writestr(zipfile.ZipInfo(f"{NAME}/{name}", (1980, 1, 1, 0, 0, 0)), path.read_bytes())
    except OSError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(4)
    print(sys.argv[1])


if __name__ == "__main__":
    main()
