//! texelwalk bakes diffuse global illumination into lightmaps or vertex colours for glTF assets.

pub mod atlas;
pub mod bake;
pub mod base;
pub mod cli;
pub mod compare;
pub mod finish;
pub mod gather;
pub mod inspect;
pub mod light;
pub mod output;
pub mod patches;
pub mod render;
pub mod scene;
pub mod settings;
pub mod trace;
pub mod walk;
