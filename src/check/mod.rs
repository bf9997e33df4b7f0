//! Is a baked lightmap clean? The measures of `texelwalk check`.
//!
//! In: a baked document, [`Baked`]. Out: [`Report`], as a table ([`Report::to_text`]) or JSON, and pictures of the worst
//! places in the scene ([`pictures`]).
//!
//! Nothing but the document and its pages is looked at, so bakes of other programs can be checked that use the same
//! references (`MOZ_lightmap`, `extras.lightmap`). Every measure ([`Kind`]) has a value, a limit, and the places where it
//! is worst: `uv` looks at the coordinates, `padding` at what bilinear look-ups at borders read, `mips` at what small mip
//! levels do, `seams` at borders across which light should go on, `leaks` at walls, `texels` at single values, `density`
//! at size and shape, `page`, `files` and `black` at the files. `subject` prepares what they share, `sight` knows what
//! nobody gets to see, `foreign` what light charts have, `treatment` what rules were baked by.
//!
//! Invariant: the same report at any thread count. Memory and time in proportion to texels and triangles.
//!
//! Limits: values are compared as they are stored; light at vertices has no texels and is not checked.

mod black;
mod charts;
mod density;
mod files;
mod foreign;
mod leaks;
mod measure;
mod mips;
mod padding;
mod page;
pub mod pictures;
mod runs;
mod seams;
mod sight;
mod subject;
mod table;
mod texels;
mod treatment;
mod uv;

pub use density::MeshDensity;
pub use measure::{Kind, Measure, PLACES, Place};
pub use page::PageFacts;

use crate::base::{Progress, Warning};
use crate::output;
use crate::render::Lightmaps;
use crate::scene::{self, Scene};
use crate::trace::Tracer;
use foreign::Foreign;
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;
use std::path::Path;
use subject::Subject;

/// What to ask of a lightmap.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settings {
    /// Limits other than the usual ones.
    pub limits: BTreeMap<Kind, f64>,
    /// Empty texels that must lie between charts; `None` = as many as bilinear look-ups need.
    pub padding: Option<u32>,
}

impl Settings {
    /// The largest value that is no fault.
    #[must_use]
    pub fn limit(&self, kind: Kind) -> f64 {
        self.limits.get(&kind).copied().unwrap_or(kind.limit())
    }
}

/// A baked document with its lightmap.
#[derive(Debug)]
pub struct Baked {
    /// The document.
    pub scene: Scene,
    /// Its pages, without values that are no light.
    pub lightmaps: Lightmaps,
    /// What was odd about the document.
    pub warnings: Vec<Warning>,
    bad: Vec<texels::Bad>,
    /// Why there are no pages.
    unreadable: Option<String>,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The document cannot be loaded.
    #[error(transparent)]
    Scene(#[from] scene::Error),
    /// The document has no lightmap, or one that nothing can be said about.
    #[error(transparent)]
    Lightmap(#[from] output::Error),
}

impl Baked {
    /// Reads a document and its pages. A page that cannot be read is no error but a fault of the report.
    ///
    /// # Errors
    /// If the document cannot be read, or has no lightmap.
    pub fn load(path: &Path, scene: Option<usize>) -> Result<Self, Error> {
        let loaded = scene::load(path, &scene::Settings { scene, ..scene::Settings::default() })?;
        let (mut scene, warnings) = (loaded.output, loaded.warnings);
        treatment::adopt(&mut scene)?;
        let (lightmaps, unreadable) = match Lightmaps::load(&scene) {
            Ok(lightmaps) => (lightmaps, None),
            Err(e) if is_of_a_page(&e, path) => (Lightmaps::default(), Some(e.to_string())),
            Err(e) => return Err(e.into()),
        };
        let mut baked = Self { scene, lightmaps, warnings, bad: vec![], unreadable };
        if baked.unreadable.is_none() && baked.lightmaps.pages().is_empty() {
            let what =
                "has no lightmap pages; bake it first, and check what bake wrote (light at vertices has no texels)";
            return Err(output::Error::invalid(path, what).into());
        }
        baked.bad = texels::clean(&mut baked.lightmaps);
        Ok(baked)
    }
}

/// The error is about a picture, not about the document.
fn is_of_a_page(error: &output::Error, document: &Path) -> bool {
    match error {
        output::Error::Io { path, .. } | output::Error::Invalid { path, .. } => path != document,
        output::Error::Target { .. } | output::Error::Scene(_) | output::Error::Interrupted => false,
    }
}

/// Everything that a check found. Names are the keys of its JSON.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Report {
    /// The document.
    pub input: String,
    /// Names of the measures above their limits.
    pub faults: Vec<&'static str>,
    /// All measures.
    pub measures: Vec<Measure>,
    /// Charts, as the document shows them.
    pub charts: usize,
    /// Texels that charts touch.
    pub texels: usize,
    /// Pages in the order in which materials name them.
    pub pages: Vec<PageFacts>,
    /// Density of every primitive.
    pub density: Vec<MeshDensity>,
}

impl Report {
    /// The same with all places moved by the offset of the scene: where they are in the document [m].
    #[must_use]
    pub fn in_document(mut self, offset: DVec3) -> Self {
        for place in self.measures.iter_mut().flat_map(|m| &mut m.places) {
            place.position = (Vec3::from(place.position).as_dvec3() + offset).as_vec3().to_array();
        }
        self
    }

    /// A measure of the report; `None` if pages could not be read.
    #[must_use]
    pub fn measure(&self, kind: Kind) -> Option<&Measure> {
        self.measures.iter().find(|m| m.kind == kind)
    }
}

/// Measures a baked document.
///
/// # Errors
/// If its layout cannot be worked with: pages beyond all size, triangles that cover them over and over.
pub fn check(baked: &Baked, settings: &Settings) -> Result<Report, Error> {
    let input = baked.scene.document.path.display().to_string();
    if let Some(message) = &baked.unreadable {
        return Ok(unreadable(input, message, settings));
    }
    let tracer = Tracer::new(&baked.scene).with_any_sides();
    let subject = Subject::new(settings, &tracer, &baked.lightmaps, &Progress::default())?;
    let pages = page::facts(&subject);
    let faults = page::faults(&baked.scene.document, &baked.lightmaps)?;
    let mut measures = vec![page::measure(&subject, faults, &pages), texels::values(&subject, &baked.bad)];
    measures.extend(uv::measure(&subject, &baked.warnings));
    let seams = seams::find(&subject);
    let foreign = Foreign::new(&subject, &seams);
    measures.push(padding::padding(&subject));
    measures.extend([padding::uncovered(&subject, &foreign), mips::measure(&subject, &foreign)]);
    measures.push(seams::measure(&subject, &seams));
    measures.extend(leaks::measure(&subject));
    measures.extend([texels::invalid(&subject), texels::firefly(&subject, &seams)]);
    let (densities, density) = density::measure(&subject);
    measures.extend(densities);
    let faults = measures.iter().filter(|m| m.fault).map(|m| m.name).collect();
    let (charts, texels) = (subject.atlas.charts.len(), subject.patches.front);
    Ok(Report { input, faults, measures, charts, texels, pages, density })
}

/// The report on a document whose pages cannot be read: nothing else can be measured.
fn unreadable(input: String, message: &str, settings: &Settings) -> Report {
    let kind = Kind::Page;
    let page = Measure {
        name: kind.name(),
        about: kind.about(),
        value: 1.0,
        limit: settings.limit(kind),
        fault: 1.0 > settings.limit(kind),
        count: 1,
        of: 1,
        worst: 1.0,
        places: vec![],
        notes: vec![message.to_owned()],
        kind,
    };
    let faults = if page.fault { vec![page.name] } else { vec![] };
    Report { input, faults, measures: vec![page], charts: 0, texels: 0, pages: vec![], density: vec![] }
}
