//! Takes one picture of a scene with one of its own cameras: no tone curve, no dithering. Bevy's ambient light is
//! left as it is, for the plugin to see to.
//!
//! Frames are drawn until everything is loaded, and then until two in a row are equal byte for byte, because lightmaps
//! arrive on the device a frame or two after their meshes. Alpha starts at 0, so A = 1 where a surface is.
//!
//! Limits: perspective cameras. Bevy reads half of the width of an orthographic one (`xmag`) as the whole.

use crate::arguments::Arguments;
use crate::picture;
use crate::report::{Lights, Meshes, report};
use bevy::app::AppExit;
use bevy::asset::{LoadState, RecursiveDependencyLoadState};
use bevy::camera::{CameraMainTextureUsages, Exposure, Hdr, RenderTarget};
use bevy::core_pipeline::tonemapping::{DebandDither, Tonemapping};
use bevy::prelude::*;
use bevy::render::gpu_readback::{Readback, ReadbackComplete};
use bevy::render::render_resource::{TextureFormat, TextureUsages};
use bevy::world_serialization::WorldInstanceReady;
use std::io::Write;
use std::num::NonZero;

/// Frames within which the picture must have come to rest.
const MOST_FRAMES: u32 = 60;

/// Adds everything but the lightmaps.
pub struct ShotPlugin(pub Arguments);

/// How far it has come.
#[derive(Resource)]
struct Shot {
    arguments: Arguments,
    scene: Handle<WorldAsset>,
    ready: bool,
    seen: Vec<u8>,
    frames: u32,
}

impl Plugin for ShotPlugin {
    fn build(&self, app: &mut App) {
        let (arguments, scene) = (self.0.clone(), Handle::default());
        app.insert_resource(Shot { arguments, scene, ready: false, seen: vec![], frames: 0 });
        app.insert_resource(ClearColor(Color::NONE));
        app.add_systems(Startup, begin).add_systems(Update, (watch, aim).chain()).add_observer(take);
    }
}

fn begin(mut commands: Commands, server: Res<AssetServer>, mut shot: ResMut<Shot>) {
    let name = shot.arguments.baked.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    shot.scene = server.load(GltfAssetLabel::Scene(0).from_asset(name));
    let is_ready = |_: On<WorldInstanceReady>, mut shot: ResMut<Shot>| shot.ready = true;
    commands.spawn(WorldAssetRoot(shot.scene.clone())).observe(is_ready);
}

/// One sentence on stderr, and the exit code for it.
pub fn failed(fault: &str) -> AppExit {
    // Nothing is left to be done when stderr is closed.
    let _ = writeln!(std::io::stderr(), "error: {fault}");
    AppExit::Error(NonZero::<u8>::MIN)
}

/// Ends the program when something cannot be loaded, or the picture does not come to rest.
fn watch(mut shot: ResMut<Shot>, server: Res<AssetServer>, mut exit: MessageWriter<AppExit>) {
    let (file, id) = (shot.arguments.baked.display().to_string(), shot.scene.id());
    if let LoadState::Failed(fault) = server.load_state(id) {
        exit.write(failed(&format!("{file}: {fault}")));
    } else if let RecursiveDependencyLoadState::Failed(fault) = server.recursive_dependency_load_state(id) {
        exit.write(failed(&format!("{file}: {fault}")));
    }
    if !shot.seen.is_empty() {
        shot.frames += 1;
    }
    if shot.frames > MOST_FRAMES {
        exit.write(failed(&format!("{file}: the picture still changes after {MOST_FRAMES} frames")));
    }
}

/// Once everything is there, gives the camera something to draw on, and asks for every frame of it.
fn aim(
    mut commands: Commands,
    shot: Res<Shot>,
    server: Res<AssetServer>,
    mut images: ResMut<Assets<Image>>,
    mut cameras: Query<(Entity, &Name, &mut Camera)>,
    aimed: Query<(), With<Readback>>,
    mut exit: MessageWriter<AppExit>,
) {
    if !shot.ready || !server.is_loaded_with_dependencies(shot.scene.id()) || !aimed.is_empty() {
        return;
    }
    let wanted = |name: &Name| shot.arguments.camera.as_ref().is_none_or(|c| c == name.as_str());
    let Some(chosen) = cameras.iter().find(|(_, name, _)| wanted(name)).map(|(entity, ..)| entity) else {
        exit.write(failed(&format!("{}: no camera of that name", shot.arguments.baked.display())));
        return;
    };
    for (entity, _, mut camera) in &mut cameras {
        camera.is_active = entity == chosen;
    }
    let [width, height] = [shot.arguments.width, shot.arguments.height].map(|n| n * shot.arguments.strata);
    let mut image = Image::new_target_texture(width, height, TextureFormat::Rgba16Float, None);
    image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    let target = images.add(image);
    // The factor from nits is 2^-ev100 / 1.2: here 1.
    let exposure = Exposure { ev100: -1.2_f32.log2() };
    let plain = (Hdr, Tonemapping::None, DebandDither::Disabled, Msaa::Off, CameraMainTextureUsages::default());
    commands.entity(chosen).insert((RenderTarget::from(target.clone()), exposure, plain));
    commands.spawn(Readback::texture(target));
}

/// Looks at a frame; writes it when it is as the one before.
fn take(
    frame: On<ReadbackComplete>,
    mut shot: ResMut<Shot>,
    meshes: Meshes,
    lights: Lights,
    names: Query<&Name>,
    materials: Res<Assets<StandardMaterial>>,
    mut exit: MessageWriter<AppExit>,
) {
    let empty = frame.data.iter().all(|b| *b == 0);
    if empty || shot.seen != frame.data {
        shot.seen.clone_from(&frame.data);
        return;
    }
    let arguments = &shot.arguments;
    let size = [arguments.width, arguments.height];
    let mut written = picture::write(&arguments.picture, &frame.data, size, arguments.strata);
    if let (Ok(()), Some(path)) = (&written, &arguments.report) {
        let text = format!("{:#}\n", report(&meshes, &lights, &names, &materials));
        written = std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()));
    }
    exit.write(written.map_or_else(|fault| failed(&fault), |()| AppExit::Success));
}
