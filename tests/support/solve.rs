//! The stages of a bake up to the solver, for tests that look at single patches.

#![allow(
    dead_code,
    unreachable_pub,
    clippy::unwrap_used,
    clippy::expect_used,
    reason = "tests; each uses a part of it"
)]

use glam::Vec3;
use std::path::{Path, PathBuf};
use texelwalk::atlas::{self, Atlas};
use texelwalk::base::{Progress, Rgb};
use texelwalk::gather::{Field, Gathered, Sky as GatheredSky};
use texelwalk::light::{self, Emitters, Openings, shoot};
use texelwalk::patches::{Outlook, PatchGraph, Patches, Tilts};
use texelwalk::scene::{self, Scene, Sky};
use texelwalk::trace::Tracer;
use texelwalk::walk::{self, EmittedLines, Splat, Walk};

/// The file of a fixture.
pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// A fixture as a scene.
pub fn load(name: &str) -> Scene {
    scene::load(&fixture(name), &scene::Settings::default()).unwrap().output
}

/// A fixture under a sky of constant radiance; black below, where things that stand on the ground would see it through
/// the ground that they touch.
pub fn load_under_sky(name: &str, radiance: Rgb) -> Scene {
    let settings =
        scene::Settings { sky: Sky { ground: Rgb::ZERO, ..Sky::constant(radiance) }, ..scene::Settings::default() };
    scene::load(&fixture(name), &settings).unwrap().output
}

/// Tracer, patches and links of a scene.
pub struct Stage<'a> {
    pub tracer: Tracer<'a>,
    pub atlas: Atlas,
    pub patches: Patches,
    pub graph: PatchGraph,
    pub emitters: Emitters,
}

impl<'a> Stage<'a> {
    pub fn new(scene: &'a Scene, texels_per_meter: f32) -> Self {
        let tracer = Tracer::new(scene);
        let settings = atlas::Settings { texels_per_meter, ..atlas::Settings::default() };
        let atlas = atlas::build(&tracer, &settings).unwrap().output;
        let patches = Patches::new(&tracer, &atlas, &Progress::default());
        let graph = PatchGraph::new(&patches, &tracer, &Progress::default());
        Self { emitters: Emitters::new(scene), tracer, atlas, patches, graph }
    }

    /// Direct irradiance by shadow rays, mean of the halves.
    pub fn direct(&self, samples: u32) -> Vec<Rgb> {
        let [a, b] = self.direct_halves(samples, 1).halves;
        a.iter().zip(b).map(|(a, b)| (*a + b) * 0.5).collect()
    }

    pub fn direct_halves(&self, samples: u32, seed: u64) -> light::Direct {
        let settings = light::Settings { samples, gather_rays: 0.0, seed, directional: false };
        light::direct(
            &self.tracer,
            &self.patches,
            &self.emitters,
            (&Openings::default(), None),
            &settings,
            &Progress::default(),
        )
    }

    /// The walk, from direct irradiance or from lines of the emitters.
    pub fn walk(&self, direct: Option<&[Rgb]>, splat: Splat, lines: u64, seed: u64) -> Walk {
        self.walk_with(direct, &walk::Settings { splat, lines, bounces: None, low_discrepancy: false, seed })
    }

    pub fn walk_with(&self, direct: Option<&[Rgb]>, settings: &walk::Settings) -> Walk {
        self.walk_in((&[], None), direct, settings)
    }

    /// The same in places that light hardly goes between, or with lines by what patches look at.
    pub fn walk_in(
        &self,
        (places, outlook): (&[u32], Option<&Outlook>),
        direct: Option<&[Rgb]>,
        settings: &walk::Settings,
    ) -> Walk {
        let p = &self.patches;
        let unshot = |d: &[Rgb]| (0..p.len()).map(|i| p.scattered(i, |k| d[k] * p.exposed_area(k))).collect();
        let start = direct.map_or_else(|| vec![Rgb::ZERO; p.len()], unshot);
        let sources = shoot::Sources::new(&self.tracer, &self.emitters, settings.seed);
        let line = |k, n| sources.line(k, n);
        let emitted = EmittedLines { flux: sources.flux(), line: &line };
        let emitted = direct.is_none().then_some(&emitted);
        let start = walk::Start { unshot: start, tilts: None, places, outlook, emitted };
        walk::walk(&self.tracer, p, &self.graph, start, settings, &Progress::default())
    }

    /// Irradiance by two halves of a gather with `rays` rays each, where patches send out `radiance`.
    pub fn gather(
        &self,
        radiance: &[Rgb],
        tilts: &Tilts,
        sky: Option<GatheredSky<'_>>,
        rays: u32,
        seed: u64,
    ) -> [Vec<Rgb>; 2] {
        let (tracer, patches) = (&self.tracer, &self.patches);
        let field = Field { tracer, patches, radiance: [radiance; 2], left_out: None, tilts, sky, anew: None, seed };
        let mut gathered = Gathered::new(patches);
        gathered.add(&field, |_| rays, &Progress::default());
        gathered.halves()
    }

    /// Area-weighted mean over the exposed parts of the front patches that `keep` accepts.
    pub fn mean(&self, values: &[Rgb], keep: impl Fn(usize) -> bool) -> f64 {
        let (mut sum, mut area) = (0.0f64, 0.0f64);
        for i in (0..self.patches.front).filter(|&i| keep(i)) {
            let a = f64::from(self.patches.exposed_area(i));
            sum += a * f64::from(values[i].element_sum()) / 3.0;
            area += a;
        }
        sum / area
    }
}

/// A square with corner `o` and edges `u` and `v`, front toward u × v, as two triangles.
pub fn square(o: Vec3, u: Vec3, v: Vec3) -> [[Vec3; 3]; 2] {
    [[o, o + u, o + u + v], [o, o + u + v, o + v]]
}
