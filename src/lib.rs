//! texelwalk bakes diffuse global illumination into lightmaps or vertex colours for glTF assets.

pub mod atlas;
pub mod base;
pub mod compare;
pub mod finish;
pub mod gather;
pub mod light;
pub mod output;
pub mod patches;
pub mod render;
pub mod scene;
pub mod trace;
pub mod walk;
