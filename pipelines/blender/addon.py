"""A Blender add-on: File > Import > texelwalk baked glTF, and Object (or Render) > Verify lightmap with Cycles.

Installed as the archive that `package.py` writes (Preferences > Add-ons > Install from Disk); this file is its `__init__`.

Import adds the baked file to the scene, lit by what was baked (`view.py`), and marks its objects with the file's path.
Verify runs `verify.py` in a process of its own, so that the open scene stays as it is and Blender stays usable (Escape
stops it); afterwards the text "texelwalk verify" holds its report, and the image of that name the difference.

Without a window Verify waits for its result. Tested with Blender 5.0.1.
"""

import importlib.util
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

bl_info = {
    "name": "texelwalk baked glTF",
    "description": "Shows what texelwalk baked, and compares it with Cycles",
    "author": "texelwalk",
    "version": (1, 0, 0),
    "blender": (5, 0, 0),
    "location": "File > Import, Object and Render menus",
    "category": "Import-Export",
}

HERE = Path(__file__).resolve().parent
SOURCE = "texelwalk_file"
RESULT = "texelwalk verify"
# Exit codes of verify.py that come with a verdict.
VERDICTS = {0: "the lightmap agrees with Cycles", 7: "the lightmap differs from Cycles"}


def view_module():
    """`view.py` of this folder; the import path is left as it was."""
    path = list(sys.path)
    try:
        spec = importlib.util.spec_from_file_location("texelwalk_view", HERE / "view.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    finally:
        sys.path[:] = path


class ImportBaked(bpy.types.Operator, ImportHelper):
    """Add a glTF that texelwalk baked, lit by its lightmap or vertex light alone"""

    bl_idname, bl_label, bl_options = "import_scene.texelwalk_baked", "Import texelwalk baked glTF", {"REGISTER", "UNDO"}
    filename_ext = ".glb"
    filter_glob: bpy.props.StringProperty(default="*.glb;*.gltf", options={"HIDDEN"})

    def execute(self, context):
        path = Path(bpy.path.abspath(self.filepath)).resolve()
        try:
            made = view_module().import_baked(path)
        except Exception as error:  # noqa: BLE001 (an operator reports what it cannot do, and Blender goes on)
            self.report({"ERROR"}, f"{path.name}: {error}")
            return {"CANCELLED"}
        for thing in made:
            thing[SOURCE] = str(path)
        self.report({"INFO"}, f"{len(made)} objects from {path.name}")
        return {"FINISHED"}


class VerifyBaked(bpy.types.Operator):
    """Bake the imported file again with Cycles, and tell where its lightmap differs"""

    bl_idname, bl_label = "object.texelwalk_verify", "Verify lightmap with Cycles"
    filepath: bpy.props.StringProperty(name="Baked file", subtype="FILE_PATH", description="Empty: the file of the active object")
    samples: bpy.props.IntProperty(name="Samples", default=4, min=1)

    def execute(self, context):
        if not self.start(context):
            return {"CANCELLED"}
        if bpy.app.background:
            self.process.wait()
            return self.finish()
        self.timer = context.window_manager.event_timer_add(0.5, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def start(self, context):
        """Starts verify.py; False where there is nothing to verify."""
        path = bpy.path.abspath(self.filepath) if self.filepath else source_of(context)
        if not path:
            self.report({"ERROR"}, "import a baked file first: File > Import > texelwalk baked glTF")
            return False
        self.folder = tempfile.TemporaryDirectory()
        self.picture, said = Path(self.folder.name) / "difference.png", Path(self.folder.name) / "report.txt"
        script = ["--background", "--factory-startup", "--python", str(HERE / "verify.py"), "--"] if bpy.app.binary_path else [str(HERE / "verify.py")]
        command = [bpy.app.binary_path or sys.executable, *script, str(path), "--samples", str(self.samples), "--difference", str(self.picture)]
        self.said = said
        with open(said, "wb") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        return True

    def modal(self, context, event):
        if event.type == "ESC":
            self.process.kill()
        if event.type != "TIMER" or self.process.poll() is None:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self.timer)
        return self.finish()

    def finish(self):
        """Puts report and picture into the session."""
        text = bpy.data.texts.get(RESULT) or bpy.data.texts.new(RESULT)
        text.clear()
        text.write(self.said.read_text(encoding="utf-8", errors="replace"))
        code = self.process.returncode
        if self.picture.is_file():
            old = bpy.data.images.get(RESULT)
            if old:
                bpy.data.images.remove(old)
            image = bpy.data.images.load(str(self.picture))
            image.name = RESULT
            image.pack()
        self.folder.cleanup()
        if code in VERDICTS:
            self.report({"INFO" if code == 0 else "WARNING"}, f"{VERDICTS[code]}; see the text \"{RESULT}\"")
            return {"FINISHED"}
        self.report({"ERROR"}, f"verify.py ended with {code}; see the text \"{RESULT}\"")
        return {"CANCELLED"}


def source_of(context):
    """The baked file of the active object, else of any object in the scene."""
    active = context.view_layer.objects.active
    for thing in [active, *context.scene.objects]:
        if thing is not None and SOURCE in thing:
            return thing[SOURCE]
    return ""


def import_entry(menu, _context):
    menu.layout.operator(ImportBaked.bl_idname, text="texelwalk baked glTF (.glb/.gltf)")


def verify_entry(menu, _context):
    menu.layout.operator(VerifyBaked.bl_idname)


CLASSES = (ImportBaked, VerifyBaked)
MENUS = (("TOPBAR_MT_file_import", import_entry), ("VIEW3D_MT_object", verify_entry), ("TOPBAR_MT_render", verify_entry))


def register():
    if not (HERE / "view.py").is_file():
        raise RuntimeError("this file alone is no add-on: install the archive that `python3 package.py OUT.zip` writes")
    for entry in CLASSES:
        bpy.utils.register_class(entry)
    for menu, entry in MENUS:
        getattr(bpy.types, menu).append(entry)


def unregister():
    for menu, entry in MENUS:
        getattr(bpy.types, menu).remove(entry)
    for entry in reversed(CLASSES):
        bpy.utils.unregister_class(entry)
