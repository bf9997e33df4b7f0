//! Lists what the plugin did to a scene, for a check to compare with the document.
//!
//! In: the entities of the scene. Out: JSON `{"lit": [{"node", "material", "page", …}], "unlit": […], "lights": […]}`;
//! `page` is the path of the image in the `Lightmap` component, `lights` are those that shine.

use crate::lightmap::BakedLight;
use bevy::gltf::GltfMaterialName;
use bevy::pbr::Lightmap;
use bevy::prelude::*;
use serde_json::{Value, json};

/// Every mesh and what is beside it.
pub type Meshes<'w, 's> = Query<
    'w,
    's,
    (
        &'static ChildOf,
        Option<&'static GltfMaterialName>,
        &'static MeshMaterial3d<StandardMaterial>,
        Option<&'static Lightmap>,
        Option<&'static BakedLight>,
    ),
    With<Mesh3d>,
>;
/// Everything that shines.
pub type Lights<'w, 's> = Query<
    'w,
    's,
    (Entity, &'static InheritedVisibility),
    Or<(With<DirectionalLight>, With<PointLight>, With<SpotLight>)>,
>;

/// The list.
pub fn report(meshes: &Meshes, lights: &Lights, names: &Query<&Name>, materials: &Assets<StandardMaterial>) -> Value {
    let name = |entity| names.get(entity).map_or("", Name::as_str).to_owned();
    let (mut lit, mut unlit) = (vec![], vec![]);
    for (parent, material_name, material, lightmap, light) in meshes {
        let (node, material_name) = (name(parent.parent()), material_name.map(|n| n.0.clone()));
        let Some(lightmap) = lightmap else {
            unlit.push(json!({"node": node, "material": material_name}));
            continue;
        };
        lit.push(json!({
            "node": node,
            "material": material_name,
            "page": lightmap.image.path().map(ToString::to_string),
            "rect": lightmap.uv_rect.min.to_array().into_iter().chain(lightmap.uv_rect.max.to_array()).collect::<Vec<_>>(),
            "bicubic": lightmap.bicubic_sampling,
            "scale": light.map(|l| l.scale),
            "exposure": materials.get(&material.0).map(|m| m.lightmap_exposure),
        }));
    }
    let shining: Vec<_> = lights.iter().filter(|(_, seen)| seen.get()).map(|(entity, _)| name(entity)).collect();
    json!({"lit": lit, "unlit": unlit, "lights": shining})
}
