"""Gives Cycles the lights that texelwalk bakes: glTF's range and cones, sizes of lights, the sky, the environment.

In: a scene that Blender's importer made in its unit-less mode from a file whose lights are named `LIGHT_MARK` + number,
and what the command line of the bake said. Out: Blender lights and a world to match.

Source: `KHR_lights_punctual`. Blender's importer ignores a light's range, and its spots have another falloff between the
cones; so spots become point lights, and both windows become nodes of the light:
  range    max(0, min(1, 1 − (d/range)⁴))
  cone     clamp((cos α − cos outer)/max(0.001, cos inner − cos outer), 0, 1)²
World +y of glTF is +z of Blender.
"""

import math
from dataclasses import dataclass

import bpy
from mathutils import Vector

from gltf_file import GltfError
from gltf_nodes import Nodes

LIGHTS = "KHR_lights_punctual"
LIGHT_MARK = "texelwalk light "
BLACK = (0.0, 0.0, 0.0)


@dataclass
class Light:
    """What options of `bake` say about light: radiances [cd/m²], sizes of lights (None = as the file says), the map."""

    sky: tuple = (BLACK, BLACK, BLACK)
    sun_angle_degrees: float | None = None
    light_radius: float | None = None
    environment: str | None = None
    environment_intensity: float = 1.0
    environment_rotation_degrees: float = 0.0


def apply(gltf, light):
    """Shapes the lights of the scene and makes its world."""
    entries = gltf.json.get("extensions", {}).get(LIGHTS, {}).get("lights", [])
    for thing in [o for o in bpy.data.objects if o.type == "LIGHT" and o.data.name.startswith(LIGHT_MARK)]:
        shape(thing, entries[int(thing.data.name[len(LIGHT_MARK):].split(".")[0])], light)
    add_world(light)


def size_of(entry, key, override):
    """Radius [m] or angle [rad] of a light: the option, else a sound number in its extras, else 0."""
    if override is not None:
        return override
    value = (entry.get("extras") or {}).get(key)
    return float(value) if isinstance(value, (int, float)) and value >= 0.0 else 0.0


def shape(thing, entry, light):
    """Brings one light to the definitions above."""
    if entry["type"] == "directional":
        override = None if light.sun_angle_degrees is None else math.radians(light.sun_angle_degrees)
        thing.data.angle = size_of(entry, "angle", override)
        return
    thing.data.shadow_soft_size = size_of(entry, "radius", light.light_radius)
    has_range = float(entry.get("range", 0.0)) > 0.0
    if entry["type"] == "spot":
        thing.data.type = "POINT"
    data = thing.data
    # A sphere of even radiance; Blender's default fades where it dips into a surface.
    data.use_soft_falloff = False
    if entry["type"] != "spot" and not has_range:
        return
    data.use_nodes = True
    tree = data.node_tree
    strength = window(tree, float(entry["range"])) if has_range else 1.0
    if entry["type"] == "spot":
        axis = thing.matrix_world.to_3x3() @ Vector((0.0, 0.0, -1.0))
        strength = Nodes.math(tree, "MULTIPLY", strength, cone(tree, entry.get("spot", {}), axis.normalized()))
    emission = next(n for n in tree.nodes if n.type == "EMISSION")
    tree.links.new(strength, emission.inputs["Strength"])


def window(tree, reach):
    """The factor of a range [m] at the distance from the light."""
    distance = tree.nodes.new("ShaderNodeLightPath").outputs["Ray Length"]
    fourth = Nodes.math(tree, "POWER", Nodes.math(tree, "DIVIDE", distance, reach), 4.0)
    return Nodes.math(tree, "MAXIMUM", Nodes.math(tree, "SUBTRACT", 1.0, fourth), 0.0)


def cone(tree, spot, axis):
    """The factor of a spot's cones in the direction in which light leaves it."""
    outer = min(max(float(spot.get("outerConeAngle", math.pi / 4)), 0.0), math.pi / 2)
    inner = min(max(float(spot.get("innerConeAngle", 0.0)), 0.0), outer)
    dot = tree.nodes.new("ShaderNodeVectorMath")
    dot.operation = "DOT_PRODUCT"
    dot.inputs[1].default_value = axis
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Incoming"], dot.inputs[0])
    width = max(0.001, math.cos(inner) - math.cos(outer))
    part = Nodes.math(tree, "DIVIDE", Nodes.math(tree, "SUBTRACT", dot.outputs["Value"], math.cos(outer)), width)
    part = Nodes.math(tree, "MINIMUM", Nodes.math(tree, "MAXIMUM", part, 0.0), 1.0)
    return Nodes.math(tree, "MULTIPLY", part, part)


def add_world(light):
    """Radiance from infinity: the sky plus the environment map."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    background = tree.nodes["Background"]
    background.inputs["Strength"].default_value = 1.0
    zenith, horizon, ground = light.sky
    if light.environment is None and zenith == horizon == ground:
        background.inputs["Color"].default_value = (*zenith, 1.0)
        return
    color = sky(tree, zenith, horizon, ground)
    if light.environment is not None:
        color = added(tree, color, environment(tree, light))
    tree.links.new(color, background.inputs["Color"])


def added(tree, a, b):
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "ADD"
    tree.links.new(a, node.inputs[0])
    tree.links.new(b, node.inputs[1])
    return node.outputs[0]


def sky(tree, zenith, horizon, ground):
    """Linear in the sine of the elevation from horizon to zenith, one colour below."""
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], split.inputs[0])
    height = split.outputs["Z"]
    rise = Nodes.scaled(tree, Nodes.color(tree, [z - h for z, h in zip(zenith, horizon)]), height)
    below = Nodes.math(tree, "LESS_THAN", height, 0.0)
    upper = Nodes.scaled(tree, added(tree, rise, Nodes.color(tree, horizon)), Nodes.math(tree, "SUBTRACT", 1.0, below))
    return added(tree, upper, Nodes.scaled(tree, Nodes.color(tree, ground), below))


def environment(tree, light):
    """The equirectangular map; Blender's own convention is texelwalk's, and its turn is the other way round."""
    try:
        image = bpy.data.images.load(light.environment)
    except RuntimeError as error:
        raise GltfError(f"{light.environment}: Blender cannot read the environment map: {error}") from None
    image.colorspace_settings.name = "Linear Rec.709"
    turn = tree.nodes.new("ShaderNodeVectorRotate")
    turn.rotation_type = "Z_AXIS"
    turn.inputs["Angle"].default_value = -math.radians(light.environment_rotation_degrees)
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"], turn.inputs["Vector"])
    node = tree.nodes.new("ShaderNodeTexEnvironment")
    node.image, node.interpolation = image, "Closest"
    tree.links.new(turn.outputs[0], node.inputs["Vector"])
    return Nodes.scaled(tree, node.outputs["Color"], light.environment_intensity)
