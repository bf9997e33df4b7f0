"""Installs the add-on's archive into an empty Blender, uses it as an artist would, and removes it again.

    blender_addon.py ARCHIVE.zip AGREEING.glb NO_LIGHTMAP.gltf

Run with Python that has Blender's module, BLENDER_USER_RESOURCES set to an empty folder. Ends with 0, or says what is wrong.
"""

import sys

import bpy

MODULE = "texelwalk_blender"
MENUS = ("TOPBAR_MT_file_import", "VIEW3D_MT_object", "TOPBAR_MT_render")


def entries():
    """How many entries the menus have that are not Blender's own."""
    return [len(getattr(bpy.types, menu).draw._draw_funcs) if hasattr(getattr(bpy.types, menu).draw, "_draw_funcs") else 1 for menu in MENUS]


def expect(what, holds):
    if not holds:
        sys.exit(f"add-on: {what}")


def refused(operator, **options):
    """Whether an operator says that it cannot: in scripts an error report is an exception."""
    try:
        return operator(**options) == {"CANCELLED"}
    except RuntimeError:
        return True


def main(archive, agreeing, no_lightmap):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    before, path = entries(), list(sys.path)
    bpy.ops.preferences.addon_install(filepath=archive, overwrite=True)
    bpy.ops.preferences.addon_enable(module=MODULE)
    expect("its menus have no entries", all(a == b + 1 for a, b in zip(entries(), before)))
    expect("verifies without a file", refused(bpy.ops.object.texelwalk_verify))
    expect("imports what was not baked", refused(bpy.ops.import_scene.texelwalk_baked, filepath=no_lightmap))
    keeper = bpy.data.objects.new("mine", None)
    bpy.context.scene.collection.objects.link(keeper)
    expect("import failed", bpy.ops.import_scene.texelwalk_baked(filepath=agreeing) == {"FINISHED"})
    expect("import removed what was there", "mine" in bpy.data.objects)
    meshes = [o for o in bpy.data.objects if o.type == "MESH"]
    expect("import made no mesh", bool(meshes))
    outputs = [n for m in bpy.data.materials for n in m.node_tree.nodes if n.type == "OUTPUT_MATERIAL" and n.is_active_output]
    expect("the materials do not show the lightmap", bool(outputs) and all(n.label == "texelwalk" for n in outputs))
    expect("verify failed", bpy.ops.object.texelwalk_verify(samples=1) == {"FINISHED"})
    said = bpy.data.texts["texelwalk verify"].as_string()
    expect(f"its report is\n{said}", "they agree" in said)
    expect("there is no picture", bpy.data.images["texelwalk verify"].size[0] > 300)
    expect("verify touched the scene", "mine" in bpy.data.objects and len([o for o in bpy.data.objects if o.type == "MESH"]) == len(meshes))
    bpy.ops.preferences.addon_disable(module=MODULE)
    expect("its menu entries stay", entries() == before)
    expect("its operators stay", not hasattr(bpy.types, "IMPORT_SCENE_OT_texelwalk_baked") and not hasattr(bpy.types, "OBJECT_OT_texelwalk_verify"))
    left = [p for p in sys.path if p not in path and MODULE in p]
    expect(f"it leaves {left} in the import path", not left)


if __name__ == "__main__":
    main(*sys.argv[1:])
