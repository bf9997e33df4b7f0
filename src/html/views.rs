//! Pictures of the scene from the document's cameras, or from one that is found: baked, plain, charts, density.

use super::{Error, Image, Subject, photo};
use crate::render::{self, Lightmaps, Overlay, Settings, View};
use crate::trace::Tracer;

/// Cameras of which pictures are taken.
pub(super) const MOST_VIEWS: usize = 3;
/// Pixels of a picture: nearly the width of the page's column, and about 60 kB as JPEG.
const SIZE: [u32; 2] = [768, 512];
/// Rays per pixel; 9 take twice the time and are hardly to be told from these.
const SAMPLES: u32 = 4;

/// One camera.
#[derive(Debug)]
pub(super) struct ViewPictures {
    /// Name of the camera, or `auto`.
    pub(super) camera: String,
    /// [stops]
    pub(super) exposure: f32,
    pub(super) baked: Image,
    pub(super) plain: Image,
    /// Charts and density, where there are texels.
    pub(super) texels: Option<[Image; 2]>,
}

/// The settings of a picture.
pub(super) fn settings(view: View, [width, height]: [u32; 2], samples: u32) -> Settings {
    Settings { width, height, samples, view, ..Settings::default() }
}

pub(super) fn views(subject: &Subject<'_>, tracer: &Tracer<'_>, lit: &Lightmaps) -> Result<Vec<ViewPictures>, Error> {
    let cameras = tracer.scene().cameras.iter().take(MOST_VIEWS);
    let mut all: Vec<View> = cameras.map(|camera| View::Camera(camera.number)).collect();
    if all.is_empty() {
        all.push(View::Auto);
    }
    let on_pages = subject.vertices.is_none();
    all.into_iter().map(|view| one(subject, tracer, lit, view, on_pages)).collect()
}

fn one(
    subject: &Subject<'_>,
    tracer: &Tracer<'_>,
    lit: &Lightmaps,
    view: View,
    on_pages: bool,
) -> Result<ViewPictures, Error> {
    let overlays = [Overlay::None, Overlay::Plain, Overlay::Charts, Overlay::Density];
    let wanted = if on_pages { &overlays[..] } else { &overlays[..2] };
    let shown = render::series(tracer, lit, &settings(view, SIZE, SAMPLES), wanted)?;
    let (camera, exposure) = shown.first().map_or((String::new(), 0.0), |p| (p.camera.clone(), p.exposure));
    let mut images = vec![];
    for picture in &shown {
        images.push(photo(subject.path, SIZE, &picture.pixels)?);
    }
    let mut images = images.into_iter();
    let missing = || Error::Render(render::Error::Size { width: SIZE[0], height: SIZE[1], samples: SAMPLES });
    let (baked, plain) = images.next().zip(images.next()).ok_or_else(missing)?;
    Ok(ViewPictures { camera, exposure, baked, plain, texels: images.next().zip(images.next()).map(|(a, b)| [a, b]) })
}
