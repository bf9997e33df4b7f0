"""Writes into a Blender node tree what a glTF material does with light that falls on it: what it scatters, and what passes.

In and out: as `gltf_nodes.py`. Of the light that a diffuse surface of colour c = base colour × (1 − metallic) would scatter,
`KHR_materials_transmission` lets the share f pass straight on, and `KHR_materials_diffuse_transmission` sends the share d
of the rest out on the other side, in a colour t × (1 − metallic) of its own. So

    reflected (1 − d)(1 − f) c      straight f c      beyond d (1 − f)(1 − metallic) t

Limits: `KHR_materials_volume` is left out, so what glass is thought to swallow inside stays; `swallows` tells.
"""

from dataclasses import dataclass

from gltf_nodes import UNLIT, Nodes

STRAIGHT = "KHR_materials_transmission"
BEYOND = "KHR_materials_diffuse_transmission"
VOLUME = "KHR_materials_volume"


@dataclass
class Optics:
    """Node outputs: colours, None where there is nothing of it; alpha is an output or a number."""

    reflected: object
    alpha: object
    straight: object = None
    beyond: object = None


def extension(source, name):
    """Takes part in light if the material is not unlit."""
    extensions = source.get("extensions", {})
    return {} if UNLIT in extensions else extensions.get(name, {})


def is_translucent(source):
    """Light falls on both of its sides."""
    return float(extension(source, BEYOND).get("diffuseTransmissionFactor", 0.0)) > 0.0


def swallows(source):
    """It has a volume that takes light, which is not known here."""
    volume = extension(source, VOLUME)
    passes = float(extension(source, STRAIGHT).get("transmissionFactor", 0.0)) > 0.0
    return passes and float(volume.get("thicknessFactor", 0.0)) > 0.0 and "attenuationDistance" in volume


class OpticNodes(Nodes):
    """Builds nodes for what glTF materials scatter and let through."""

    def optics(self, tree, source, has_color):
        """All shares of the light, as defined above."""
        color, alpha = self.base_color(tree, source, has_color)
        diffuse = self.diffuse_share(tree, source)
        scattered = self.scaled(tree, color, diffuse)
        passing = self.share(tree, extension(source, STRAIGHT), "transmission", "Red")
        beyond = self.share(tree, extension(source, BEYOND), "diffuseTransmission", "Alpha")
        if passing is None and beyond is None:
            return Optics(scattered, alpha)
        found = Optics(scattered, alpha)
        if passing is not None:
            found.straight = self.scaled(tree, scattered, passing)
            found.reflected = self.less(tree, found.reflected, passing)
        if beyond is not None:
            found.beyond = self.scaled(tree, self.color_beyond(tree, source), diffuse)
            found.beyond = self.scaled(tree, found.beyond, beyond)
            if passing is not None:
                found.beyond = self.less(tree, found.beyond, passing)
            found.reflected = self.less(tree, found.reflected, beyond)
        return found

    def share(self, tree, entry, name, channel):
        """Factor × a channel of its texture, both `name`…: an output or a number, None if it is 0."""
        factor = min(max(float(entry.get(f"{name}Factor", 0.0)), 0.0), 1.0)
        if factor == 0.0 or f"{name}Texture" not in entry:
            return factor or None
        node = self.texture(tree, entry[f"{name}Texture"], False)
        texel = node.outputs["Alpha"] if channel == "Alpha" else self.channels(tree, node.outputs["Color"])[0]
        return self.math(tree, "MULTIPLY", texel, factor)

    def less(self, tree, color, share):
        """What is left of a colour."""
        return self.scaled(tree, color, self.math(tree, "SUBTRACT", 1.0, share))

    def color_beyond(self, tree, source):
        entry = extension(source, BEYOND)
        color = self.color(tree, [float(x) for x in entry.get("diffuseTransmissionColorFactor", (1.0, 1.0, 1.0))])
        if "diffuseTransmissionColorTexture" not in entry:
            return color
        return self.scaled(tree, color, self.texture(tree, entry["diffuseTransmissionColorTexture"], True).outputs["Color"])
