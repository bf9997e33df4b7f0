//! What the stages compute, one file for each property. One program: to compile and link each of them by itself takes a
//! minute more.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../support/baked.rs"]
mod baked;
#[path = "../support/gltf.rs"]
mod gltf;
#[path = "../support/gltf_builder.rs"]
mod gltf_builder;
#[path = "../support/quads.rs"]
mod quads;
#[path = "../support/sealed.rs"]
mod sealed;
#[path = "../support/solve.rs"]
mod solve;
#[path = "../support/mod.rs"]
mod support;

mod alarms;
mod alike;
mod basis;
mod bright;
mod check;
mod choices;
mod contact;
mod covered;
mod cut_contacts;
mod directional;
mod emitters;
mod far;
mod glare;
mod glass;
mod ies;
mod image_light;
mod layers;
mod leaks;
mod light;
mod lost_light;
mod map_files;
mod mips;
mod near;
mod normal_maps;
mod openings;
mod output;
mod overlaid;
mod party;
mod places;
mod quantized;
mod ray_origins;
mod rays;
mod rays_together;
mod rebake;
mod render;
mod rewrite;
mod rules;
mod seams;
mod settled;
mod sides;
mod solver;
mod specks;
mod splice;
mod stated;
mod terminator;
mod thin_shadows;
mod vertex_output;
