//! Rules and `extras` put together: the [`Treatment`] of every primitive, intensity and group of every light.
//!
//! Of what is said about a key, the most particular counts, and factors are not multiplied with each other. For a
//! primitive, in rising order: `extras` of its material, of its mesh, of the nodes from the root of the tree down to its
//! own, then all rules that match, the later ones in the file above the earlier. For a light: its own `extras`, the nodes,
//! the rules. So what is said of a node holds for everything below it, unless something below it says otherwise, and
//! rules have the last word.
//!
//! Names are those of the document; what has none is called as in messages, `node 7`, `mesh 3`, `material 2`, `light 0`,
//! and what has no material has `default material`.
//!
//! Warnings: `unused-rule` for rules that changed nothing, `dark-emitter`, and those of `extras.rs`; `deforming-mesh` and
//! `animated-node` unless somebody has said that the node shall not receive light.

use super::extras::{self, OF_LIGHTS, OF_NODES, OF_SURFACES};
use super::nodes::Walk;
use super::rules::{Glob, Rule, Treatment, Wishes};
use super::schema::Root;
use super::schema::label;
use super::{Error, Instances, Material, Part, Scene, Settings};
use crate::base::Warning;
use std::borrow::Cow;

/// What holds for a node.
#[derive(Debug, Clone, Default)]
struct OfNode {
    wishes: Wishes,
    /// Rules whose patterns match the node or one above it, ascending.
    rules: Vec<usize>,
}

/// All that is said about the things of a document.
pub(super) struct Treater<'a> {
    root: &'a Root,
    rules: &'a [Rule],
    /// Of what says nothing else.
    instances: Instances,
    /// By rule.
    used: Vec<bool>,
    nodes: Vec<OfNode>,
    meshes: Vec<Wishes>,
    materials: Vec<Wishes>,
    lights: Vec<Wishes>,
}

fn is_any(globs: &[Glob], name: &str) -> bool {
    globs.iter().any(|glob| glob.matches(name))
}

/// Its name, or `kind 7`.
fn name_of<'a>(name: Option<&'a str>, kind: &str, index: usize) -> Cow<'a, str> {
    name.filter(|n| !n.is_empty()).map_or_else(|| format!("{kind} {index}").into(), Cow::from)
}

/// `mesh 3 "Chair"`, for messages.
fn owner(name: Option<&str>, kind: &str, index: usize) -> String {
    match name.filter(|n| !n.is_empty()) {
        Some(_) => format!("{kind} {index} \"{}\"", label(name, kind, index)),
        None => format!("{kind} {index}"),
    }
}

impl<'a> Treater<'a> {
    /// Reads the `extras` of everything.
    pub(super) fn new(root: &'a Root, walk: &Walk, settings: &'a Settings, warnings: &mut Vec<Warning>) -> Self {
        let rules = settings.rules.as_slice();
        let meshes = root
            .meshes
            .iter()
            .enumerate()
            .map(|(i, m)| extras::read(&m.extras, OF_SURFACES, &owner(m.name.as_deref(), "mesh", i), warnings));
        let meshes = meshes.collect();
        let materials = root
            .materials
            .iter()
            .enumerate()
            .map(|(i, m)| extras::read(&m.extras, OF_SURFACES, &owner(m.name.as_deref(), "material", i), warnings));
        let materials = materials.collect();
        let lights = root.lights().iter().enumerate().map(|(i, l)| {
            let own = l
                .extras
                .get("texelwalk")
                .filter(|own| !own.is_null())
                .cloned()
                .map_or(extras::Own::Missing, extras::Own::Value);
            extras::read(&own, OF_LIGHTS, &owner(l.name.as_deref(), "light", i), warnings)
        });
        let lights = lights.collect();
        let nodes = of_nodes(root, walk, rules, warnings);
        Self {
            root,
            rules,
            instances: settings.instances,
            used: vec![false; rules.len()],
            nodes,
            meshes,
            materials,
            lights,
        }
    }

    /// Treats all parts; the light groups of those that glow.
    pub(super) fn parts(
        &mut self,
        walk: &Walk,
        parts: &mut [Part],
        materials: &[Material],
        warnings: &mut Vec<Warning>,
    ) -> Result<Vec<Option<String>>, Error> {
        let mut animated = vec![false; self.root.nodes.len()];
        walk.placed.iter().for_each(|placed| animated[placed.node] = placed.animated);
        let mut groups = Vec::with_capacity(parts.len());
        for part in parts {
            let material = &materials[part.material];
            let wishes = self.of_part(part, material);
            part.treatment = wishes.treatment();
            part.treatment.instances = wishes.instances.unwrap_or(self.instances);
            part.receives &= part.treatment.receives;
            let glows = material.glows() && part.treatment.emission > 0.0;
            if glows && !(material.emission * part.treatment.emission).is_finite() {
                let what = format!("its emission times {} is not finite", part.treatment.emission);
                return Err(Error::invalid(format!("node {}, material {}: {what}", part.name, material.name)));
            }
            if glows && !part.treatment.casts {
                let what = format!(
                    "node {} casts no light, so what its material {} emits was left out; an emission of 0 says so \
                     without this warning",
                    part.name, material.name
                );
                warnings.push(Warning::new("dark-emitter", what).at(&part.name));
            }
            warnings.extend(motion(self.root, part, animated[part.node]));
            groups.push(wishes.light_group.filter(|_| glows));
        }
        Ok(groups)
    }

    fn of_part(&mut self, part: &Part, material: &Material) -> Wishes {
        let of_node = &self.nodes[part.node];
        let below = self.meshes[part.mesh].clone();
        let below = self.materials.get(part.material).map_or(below.clone(), |own| below.over(own));
        let mut wishes = of_node.wishes.clone().over(&below);
        let mesh = name_of(self.root.meshes[part.mesh].name.as_deref(), "mesh", part.mesh);
        let entry = self.root.materials.get(part.material);
        let called = entry.map_or(Cow::from(&material.name), |m| name_of(m.name.as_deref(), "material", part.material));
        for (r, rule) in self.rules.iter().enumerate() {
            let fits = rule.lights.is_empty()
                && (rule.nodes.is_empty() || of_node.rules.contains(&r))
                && (rule.meshes.is_empty() || is_any(&rule.meshes, &mesh))
                && (rule.materials.is_empty() || is_any(&rule.materials, &called));
            if fits {
                let own = rule.wishes();
                let about_light = own.emission.is_some() || own.light_group.is_some();
                self.used[r] |= own.density.is_some()
                    || own.receives.is_some()
                    || own.casts.is_some()
                    || own.instances.is_some()
                    || about_light && material.glows();
                wishes = own.over(&wishes);
            }
        }
        wishes
    }

    /// Factor of the intensity of a light that a node places, and its group.
    pub(super) fn light(&mut self, node: usize, light: usize) -> (f32, Option<String>) {
        let name = name_of(self.root.lights()[light].name.as_deref(), "light", light);
        let own = self.lights[light].clone();
        self.light_called(node, &name, &own)
    }

    /// The same for one of `EXT_lights_ies`.
    pub(super) fn profile(&mut self, node: usize, profile: usize) -> (f32, Option<String>) {
        let name = name_of(self.root.profiles()[profile].name.as_deref(), "light", profile);
        self.light_called(node, &name, &Wishes::default())
    }

    fn light_called(&mut self, node: usize, name: &str, own: &Wishes) -> (f32, Option<String>) {
        let of_node = &self.nodes[node];
        let mut wishes = of_node.wishes.clone().over(own);
        for (r, rule) in self.rules.iter().enumerate() {
            let fits = rule.meshes.is_empty()
                && rule.materials.is_empty()
                && (rule.nodes.is_empty() || of_node.rules.contains(&r))
                && (rule.lights.is_empty() || is_any(&rule.lights, name));
            if fits {
                let own = rule.wishes();
                self.used[r] |= own.intensity.is_some() || own.light_group.is_some();
                wishes = own.over(&wishes);
            }
        }
        (wishes.intensity.unwrap_or(1.0), wishes.light_group)
    }

    /// Rules that changed nothing.
    pub(super) fn unused(&self) -> impl Iterator<Item = Warning> + '_ {
        self.rules.iter().zip(&self.used).enumerate().filter(|(_, (_, used))| !**used).map(|(r, (rule, _))| {
            let text = serde_json::to_string(rule).unwrap_or_default();
            let what = format!("rule {} of the configuration matches nothing that it could change: {text}", r + 1);
            Warning::new("unused-rule", what)
        })
    }
}

/// Wishes and rules of every node of the scene, with what they inherit.
fn of_nodes(root: &Root, walk: &Walk, rules: &[Rule], warnings: &mut Vec<Warning>) -> Vec<OfNode> {
    let mut nodes = vec![OfNode::default(); root.nodes.len()];
    for placed in &walk.placed {
        let (index, node) = (placed.node, &root.nodes[placed.node]);
        let (first, name) = (warnings.len(), root.node_name(index));
        let own = extras::read(&node.extras, OF_NODES, &format!("node {name}"), warnings);
        warnings[first..].iter_mut().for_each(|warning| warning.node = Some(name.clone()));
        let called = name_of(node.name.as_deref(), "node", index);
        let mut here = core::mem::take(&mut nodes[index]);
        here.wishes = own.over(&here.wishes);
        here.rules.extend((0..rules.len()).filter(|&r| is_any(&rules[r].nodes, &called)));
        here.rules.sort_unstable();
        here.rules.dedup();
        // Parents come before their children.
        node.children.iter().for_each(|&child| nodes[child] = here.clone());
        nodes[index] = here;
    }
    nodes
}

/// What cannot keep its light because it moves.
fn motion(root: &Root, part: &Part, animated: bool) -> Option<Warning> {
    let Treatment { receives, casts, .. } = part.treatment;
    let name = &part.name;
    // Further instances say the same.
    if root.nodes.get(part.node).is_some_and(|node| node.instance > 0) {
        return None;
    }
    if is_deforming(root, part) {
        let blocks = if casts { "it blocks light as it stands at rest, but gets" } else { "it gets" };
        let what = format!("node {name} is skinned or morphed: {blocks} no lightmap");
        return receives.then(|| Warning::new("deforming-mesh", what).at(name));
    }
    let done = if receives { "was baked" } else { "blocks light" };
    let told = animated && part.primitive == 0 && (receives || casts);
    told.then(|| {
        let what = format!("node {name} is animated: it {done} where it stands at rest");
        Warning::new("animated-node", what).at(name)
    })
}

fn is_deforming(root: &Root, part: &Part) -> bool {
    let skinned = root.nodes.get(part.node).is_some_and(|node| node.skin.is_some());
    let primitive = root.meshes.get(part.mesh).and_then(|mesh| mesh.primitives.get(part.primitive));
    skinned || primitive.is_some_and(|p| !p.targets.is_empty())
}

impl Scene {
    /// Treats a part otherwise than it was.
    pub fn treat(&mut self, part: usize, treatment: Treatment) {
        let entry = &self.parts[part];
        let may = !(self.materials[entry.material].unlit || is_deforming(&self.document.root, entry));
        self.parts[part].treatment = treatment;
        self.parts[part].receives = may && treatment.receives;
    }

    /// The part lights others.
    #[must_use]
    pub fn glows(&self, part: &Part) -> bool {
        part.treatment.casts && part.treatment.emission > 0.0 && self.materials[part.material].glows()
    }
}
