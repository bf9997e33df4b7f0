//! The first view once more, lit by one group of lights at a time.

use super::views::settings;
use super::{Error, Image, Subject, photo, placed};
use crate::base::Rgb;
use crate::base::color::luminance;
use crate::base::parallel;
use crate::finish::Lightmap;
use crate::render::{self, Overlay, Settings, View};

/// Groups of which pictures are taken.
pub(super) const MOST_GROUPS: usize = 12;
const SIZE: [u32; 2] = [384, 256];
const SAMPLES: u32 = 4;

/// A group of lights.
#[derive(Debug)]
pub(super) struct GroupPicture {
    pub(super) name: String,
    /// Of the light of all groups, in [0, 1]: sum of the luminance over the texels.
    pub(super) share: f64,
    /// Only the first of them have one.
    pub(super) picture: Option<Image>,
}

/// All groups; with the exposure of the view that they add up to, in stops.
pub(super) fn groups(subject: &Subject<'_>, exposure: f32) -> Result<Vec<GroupPicture>, Error> {
    let whole = light(subject.lightmap);
    let mut out = vec![];
    for (name, lightmap) in subject.groups {
        let share = if whole > 0.0 { light(lightmap) / whole } else { 0.0 };
        let picture = if out.len() < MOST_GROUPS { Some(picture(subject, lightmap, exposure)?) } else { None };
        out.push(GroupPicture { name: name.clone(), share, picture });
    }
    Ok(out)
}

fn picture(subject: &Subject<'_>, lightmap: &Lightmap, exposure: f32) -> Result<Image, Error> {
    let how = Settings { exposure: Some(exposure), ..settings(View::Default, SIZE, SAMPLES) };
    let shown = render::series(subject.tracer, &placed(subject, lightmap), &how, &[Overlay::None])?;
    photo(subject.path, SIZE, &shown.first().map_or(vec![], |p| p.pixels.clone()))
}

fn light(lightmap: &Lightmap) -> f64 {
    let of = |p: &[f32; 4]| if p[3] > 0.0 { f64::from(luminance(Rgb::new(p[0], p[1], p[2]))) } else { 0.0 };
    lightmap.pages.iter().map(|page| parallel::sum(page.pixels.len(), |i| of(&page.pixels[i]))).fold(0.0, |a, b| a + b)
}
