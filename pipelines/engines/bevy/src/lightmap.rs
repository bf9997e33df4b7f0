//! Shows light baked by texelwalk in Bevy 0.19. Copy this one file into your game.
//!
//!     app.add_plugins((DefaultPlugins, BakedLightPlugin::default()));
//!     commands.spawn(WorldAssetRoot(server.load(GltfAssetLabel::Scene(0).from_asset("room.glb"))));
//!
//! Needs Bevy's features `bevy_gltf`, `bevy_pbr` and `exr`, and the crate `serde_json`.
//!
//! In: materials with `MOZ_lightmap` (texture `index`, `texCoord`, `intensity`), whose texture names an EXR in
//! `extras.lightmap.uri`. Its texel × intensity is irradiance E [lx].
//! Out: Bevy's `Lightmap` beside each `Mesh3d` with such a material, so that base colour × (1 − metallic) × E/π [cd/m²]
//! leaves the surface. The camera's `Exposure` scales it, like all light in Bevy: what was baked with a few lux is
//! black under the default, made for daylight. `Exposure { ev100: -1.2_f32.log2() }` multiplies by 1.
//!
//! * Emission is weighted by the exposure too, as the bake and the lamps are; Bevy by itself does not.
//! * The lights of a baked document are hidden, or kept for what has no lightmap: [`Lamps`]. Documents without a bake
//!   keep theirs. Ambient light (80 cd/m² by default!) is switched off for lightmapped meshes before the first
//!   `Startup` system; `AmbientLight` of a camera, and environment maps, have an `affects_lightmapped_…` of their own.
//! * A page is loaded once, linear and clamped, without mip levels, as half floats on the device.
//! * Limits: `TEXCOORD_1` alone, because Bevy knows no other; no `KHR_texture_transform` inside `MOZ_lightmap`; no light
//!   at vertices; no skins or morph targets, for which Bevy has no lightmaps. Each breach is one logged error.

use bevy::asset::{AssetEvent, AssetId, LoadContext, RenderAssetUsages};
use bevy::ecs::component::Mutable;
use bevy::ecs::world::EntityWorldMut;
use bevy::gltf::extensions::{ErasedGltfExtensionHandler, GltfExtensionHandler, GltfExtensionHandlers};
use bevy::gltf::{GltfLoaderSettings, gltf};
use bevy::image::{ExrTextureLoaderSettings, ImageSampler, TextureFormatPixelInfo};
use bevy::light::GlobalAmbientLight;
use bevy::pbr::Lightmap;
use bevy::platform::collections::HashSet;
use bevy::prelude::*;
use bevy::render::render_resource::TextureFormat;
use std::f32::consts::PI;
use std::sync::{Arc, Mutex, PoisonError};

/// What becomes of the lights of a document whose light was baked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lamps {
    /// They are hidden: `Visibility::Inherited` brings one back.
    #[default]
    Hidden,
    /// They shine on meshes without a lightmap; where there is one, they add highlights only.
    ForOthers,
}

/// Attaches baked light to every glTF that is loaded after this plugin was added.
#[derive(Clone, Debug, Default)]
pub struct BakedLightPlugin {
    /// Smoother than bilinear, at four times the samples, but no longer what `texelwalk render` shows; may leak light.
    pub bicubic: bool,
    /// The lights of baked documents.
    pub lamps: Lamps,
}

/// Beside each `Lightmap` that this plugin attached. Change it to dim the bake: materials follow.
#[derive(Component, Clone, Copy, Debug, Reflect)]
#[reflect(Component)]
pub struct BakedLight {
    /// Factor from a texel to the radiance [cd/m²] of a white surface.
    pub scale: f32,
}

/// Images that are lightmap pages. The loader names them before they are loaded.
#[derive(Resource, Clone, Debug, Default)]
struct Pages(Arc<Mutex<HashSet<AssetId<Image>>>>);

impl Plugin for BakedLightPlugin {
    fn build(&self, app: &mut App) {
        let pages = Pages::default();
        let handler = Handler { plugin: self.clone(), pages: pages.clone(), of_material: vec![] };
        let handlers = app.world_mut().get_resource_or_init::<GltfExtensionHandlers>().0.clone();
        bevy::tasks::block_on(handlers.write()).push(Box::new(handler));
        // Scenes are copied by reflection, which drops components that are not registered.
        app.register_type::<Lightmap>().register_type::<BakedLight>();
        app.insert_resource(pages);
        app.add_systems(PreStartup, keep_ambient_light_off);
        app.add_systems(PostUpdate, scale_materials);
        // After the events of the frame are out, before the render world takes the image.
        app.add_systems(Last, finish_pages);
    }
}

/// A material's lightmap.
#[derive(Clone, Debug)]
struct Page {
    uri: String,
    scale: f32,
}

/// Sees each document while it is loaded. Bevy clones it for every load.
#[derive(Clone, Debug)]
struct Handler {
    plugin: BakedLightPlugin,
    pages: Pages,
    /// By number of the material.
    of_material: Vec<Option<Page>>,
}

impl Handler {
    fn attach(&self, page: &Page, context: &mut LoadContext<'_>, entity: &mut EntityWorldMut) -> Result<(), String> {
        let path = context.path().resolve_embed_str(&page.uri).map_err(|e| format!("{}: {e}", page.uri))?;
        let device_only = |s: &mut ExrTextureLoaderSettings| s.asset_usage = RenderAssetUsages::RENDER_WORLD;
        let image: Handle<Image> = context.load_builder().with_settings(device_only).load(path);
        self.pages.0.lock().unwrap_or_else(PoisonError::into_inner).insert(image.id());
        let lightmap = Lightmap { image, bicubic_sampling: self.plugin.bicubic, ..default() };
        entity.insert((lightmap, BakedLight { scale: page.scale }));
        Ok(())
    }
}

impl GltfExtensionHandler for Handler {
    fn dyn_clone(&self) -> Box<dyn ErasedGltfExtensionHandler> {
        Box::new(self.clone())
    }

    fn on_root(&mut self, context: &mut LoadContext<'_>, gltf: &gltf::Gltf, _: &GltfLoaderSettings) {
        let logged = |fault| error!("{}: {fault}", context.path());
        self.of_material = gltf.materials().map(|m| page_of(gltf, &m).map_err(logged).ok().flatten()).collect();
    }

    fn on_spawn_mesh_and_material(
        &mut self,
        context: &mut LoadContext<'_>,
        primitive: &gltf::Primitive,
        mesh: &gltf::Mesh,
        material: &gltf::Material,
        entity: &mut EntityWorldMut,
        _: &str,
    ) {
        let page = material.index().and_then(|i| self.of_material.get(i)?.as_ref());
        let Some(page) = page else { return };
        let attached = usable(primitive).and_then(|()| self.attach(page, context, entity));
        if let Err(fault) = attached {
            error!("{}: mesh {} ({}): {fault}", context.path(), mesh.index(), mesh.name().unwrap_or("unnamed"));
        }
    }

    fn on_scene_completed(&mut self, _: &mut LoadContext<'_>, _: &gltf::Scene, _: Entity, world: &mut World) {
        if self.of_material.iter().any(Option::is_some) {
            let lamps = self.plugin.lamps;
            settle::<DirectionalLight>(world, lamps, |light| &mut light.affects_lightmapped_mesh_diffuse);
            settle::<PointLight>(world, lamps, |light| &mut light.affects_lightmapped_mesh_diffuse);
            settle::<SpotLight>(world, lamps, |light| &mut light.affects_lightmapped_mesh_diffuse);
        }
    }
}

/// Takes the lights of a kind out of what is baked already.
fn settle<L: Component<Mutability = Mutable>>(world: &mut World, lamps: Lamps, affects_baked: fn(&mut L) -> &mut bool) {
    let found: Vec<Entity> = world.query_filtered::<Entity, With<L>>().iter(world).collect();
    for entity in found {
        let mut entity = world.entity_mut(entity);
        match lamps {
            Lamps::Hidden => {
                entity.insert(Visibility::Hidden);
            }
            Lamps::ForOthers => {
                if let Some(mut light) = entity.get_mut::<L>() {
                    *affects_baked(&mut light) = false;
                }
            }
        }
    }
}

/// What Bevy needs to show a lightmap. Where a mesh deforms, its shaders lack the page, and drawing would end the game.
fn usable(primitive: &gltf::Primitive) -> Result<(), String> {
    let has = |name: &str| primitive.attributes().any(|(semantic, _)| semantic.to_string() == name);
    if !has("TEXCOORD_1") {
        return Err("its material has a lightmap on TEXCOORD_1, which it lacks".into());
    }
    if has("JOINTS_0") || primitive.morph_targets().len() > 0 {
        return Err("it has a skin or morph targets, for which Bevy has no lightmaps".into());
    }
    Ok(())
}

/// The lightmap that a material refers to, if it does.
fn page_of(gltf: &gltf::Gltf, material: &gltf::Material) -> Result<Option<Page>, String> {
    let Some(reference) = material.extension_value("MOZ_lightmap") else { return Ok(None) };
    let name = material.name().unwrap_or("unnamed");
    let fault = |what: &str| Err(format!("material {} ({name}): {what}", material.index().unwrap_or_default()));
    if reference["texCoord"].as_u64() != Some(1) {
        return fault("its lightmap is not on TEXCOORD_1, the only one that Bevy knows; bake with --uv generate");
    }
    if !reference["extensions"]["KHR_texture_transform"].is_null() {
        return fault("a lightmap with KHR_texture_transform is not supported; bake without it");
    }
    let texture = reference["index"].as_u64().and_then(|i| gltf.textures().nth(usize::try_from(i).ok()?));
    let extras = texture.and_then(|t| serde_json::from_str::<serde_json::Value>(t.extras().as_ref()?.get()).ok());
    let Some(uri) = extras.as_ref().and_then(|e| e["lightmap"]["uri"].as_str()) else {
        return fault("the texture of its lightmap names no EXR in extras.lightmap.uri; bake with texelwalk");
    };
    let intensity = reference["intensity"].as_f64().unwrap_or(1.0) as f32;
    Ok(Some(Page { uri: decoded(uri), scale: intensity / PI }))
}

/// A relative URI as the path that it names: `%20` is a space.
fn decoded(uri: &str) -> String {
    let escaped = |at: usize| u8::from_str_radix(uri.get(at..)?.strip_prefix('%')?.get(..2)?, 16).ok();
    let (mut path, mut at) = (vec![], 0);
    while at < uri.len() {
        let code = escaped(at);
        path.push(code.unwrap_or(uri.as_bytes()[at]));
        at += if code.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&path).into_owned()
}

/// Ambient light is in the bake, or was not wanted.
fn keep_ambient_light_off(mut ambient: ResMut<GlobalAmbientLight>) {
    ambient.affects_lightmapped_meshes = false;
}

type NewlyLit = Or<(Changed<BakedLight>, Changed<MeshMaterial3d<StandardMaterial>>)>;

/// Bevy keeps the factor of a lightmap in the material.
fn scale_materials(
    lit: Query<(&BakedLight, &MeshMaterial3d<StandardMaterial>), NewlyLit>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for (light, material) in &lit {
        if let Some(mut material) = materials.get_mut(&material.0) {
            material.lightmap_exposure = light.scale;
            material.emissive_exposure_weight = 1.0;
        }
    }
}

/// Bevy loads EXR as 32-bit floats, which not every device can filter; the file holds halves.
fn finish_pages(mut events: MessageReader<AssetEvent<Image>>, pages: Res<Pages>, mut images: ResMut<Assets<Image>>) {
    for event in events.read() {
        let (AssetEvent::Added { id } | AssetEvent::Modified { id }) = event else { continue };
        if !pages.0.lock().unwrap_or_else(PoisonError::into_inner).contains(id) {
            continue;
        }
        // A tracked change would upload the page a second time.
        if let Some(image) = images.get_mut_untracked(*id) {
            image.sampler = ImageSampler::linear();
            if let Err(fault) = halve(image) {
                error!("a lightmap page stays in 32 bits: {fault}");
            }
        }
    }
}

/// Turns 32-bit into 16-bit floats.
fn halve(image: &mut Image) -> Result<(), String> {
    if image.texture_descriptor.format != TextureFormat::Rgba32Float {
        return Ok(());
    }
    let format = TextureFormat::Rgba16Float;
    let texel = format.pixel_size().map_err(|e| e.to_string())?;
    let data = vec![0; (image.width() * image.height()) as usize * texel];
    let mut halved = image.clone();
    (halved.data, halved.texture_descriptor.format) = (Some(data), format);
    for y in 0..image.height() {
        for x in 0..image.width() {
            let color = image.get_color_at(x, y).map_err(|e| e.to_string())?;
            halved.set_color_at(x, y, color).map_err(|e| e.to_string())?;
        }
    }
    *image = halved;
    Ok(())
}
