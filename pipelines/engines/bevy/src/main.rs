//! Shows a baked glTF with Bevy, without a window, and writes the radiance [cd/m²] that the camera sees as an EXR.
//!
//! In: see `arguments.rs`. Out: the picture, and a list of what the plugin attached; exit code 1 and one sentence on
//! stderr when something is wrong. Needs a Vulkan driver; one in software does (Debian: mesa-vulkan-drivers).

mod arguments;
mod lightmap;
mod picture;
mod report;
mod shot;

use arguments::Arguments;
use bevy::app::{AppExit, ScheduleRunnerPlugin};
use bevy::asset::{AssetPlugin, UnapprovedPathMode};
use bevy::log::LogPlugin;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::pipelined_rendering::PipelinedRenderingPlugin;
use bevy::window::{ExitCondition, WindowPlugin};
use lightmap::{BakedLightPlugin, Lamps};
use std::path::Path;
use std::time::Duration;

fn main() -> AppExit {
    let (arguments, folder) = match arguments::parse(std::env::args().skip(1)).and_then(with_folder) {
        Ok(found) => found,
        Err(fault) => return shot::failed(&fault),
    };
    let lamps = if arguments.lamps_for_others { Lamps::ForOthers } else { Lamps::Hidden };
    let plugin = BakedLightPlugin { bicubic: arguments.bicubic, lamps };
    App::new().add_plugins((without_window(folder), plugin, shot::ShotPlugin(arguments))).run()
}

/// Bevy reads assets from a folder: the one that the document lies in.
fn with_folder(arguments: Arguments) -> Result<(Arguments, String), String> {
    let file = &arguments.baked;
    let found = std::path::absolute(file).ok().filter(|f| f.is_file());
    let found = found.ok_or(format!("{}: no such file", file.display()))?;
    let folder = found.parent().and_then(Path::to_str).ok_or(format!("{}: its path is not text", file.display()))?;
    Ok((arguments, folder.to_owned()))
}

/// Bevy's own plugins, with frames as fast as they come.
fn without_window(folder: String) -> bevy::app::PluginGroupBuilder {
    let window = WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() };
    // A document may name pictures outside of its folder.
    let assets = AssetPlugin { file_path: folder, unapproved_path_mode: UnapprovedPathMode::Allow, ..default() };
    DefaultPlugins
        .set(window)
        .set(assets)
        .set(LogPlugin { filter: "warn,wgpu_hal=error".into(), ..default() })
        // A picture must not be taken while a shader is still being compiled.
        .set(RenderPlugin { synchronous_pipeline_compilation: true, ..default() })
        .disable::<PipelinedRenderingPlugin>()
        .add(ScheduleRunnerPlugin::run_loop(Duration::ZERO))
}
