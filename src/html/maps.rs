//! Lightmap pages as pictures: light, charts, density and error, scaled down.
//!
//! A pixel stands for a square of texels. Light is the mean of those that charts cover, else of those that are dilated,
//! with the tone curve of `render` and one exposure for all pages. The error of a texel is relative to its own light; in
//! texels darker than [`DIM`] of the mean it is relative to that, because a large part of nothing is nothing.

use super::scale::{Scale, Share};
use super::{Error, Image, Subject, drawing, photo};
use crate::base::Rgb;
use crate::base::color::luminance;
use crate::base::parallel;
use crate::finish::{Lightmap, Page};
use crate::patches::Patches;
use crate::render::{self, KEY, NEUTRAL};

/// Pages of which pictures are taken.
pub(super) const MOST_MAPS: usize = 6;
/// Longest side of a picture of one page [px], and of one of several: 1.6 MB at most for one page of noise.
const SIDES: [u32; 2] = [1024, 640];
/// Pixels up to which light is stored without loss.
const MOST_DRAWN: u32 = 1 << 16;
/// Part of the mean light below which errors are relative to that part of the mean.
pub const DIM: f32 = 0.05;

/// One page.
#[derive(Debug)]
pub(super) struct MapPictures {
    pub(super) light: Image,
    pub(super) charts: Image,
    pub(super) density: Image,
    pub(super) noise: Image,
    /// Texels of a pixel, along a side.
    pub(super) texels_per_pixel: u32,
}

/// Pages and the legends of their heat maps.
#[derive(Debug, Default)]
pub(super) struct Maps {
    /// The first of them.
    pub(super) pages: Vec<MapPictures>,
    /// Over all pages.
    pub(super) density: Vec<Share>,
    /// Over all pages.
    pub(super) noise: Vec<Share>,
}

/// All maps; `density` is the median [texels/m].
pub(super) fn maps(subject: &Subject<'_>, density: f32) -> Result<Maps, Error> {
    let patches = subject.patches;
    let scales = [Scale::density(density), Scale::error()];
    let densities = parallel::map(patches.front, |i| 1.0 / patches.texel_edge(i).max(f32::MIN_POSITIVE));
    let exposure = exposure(subject.lightmap);
    let several = usize::from(subject.lightmap.pages.len() > 1);
    let mut pages = vec![];
    for (k, page) in (0..).zip(subject.lightmap.pages.iter().take(MOST_MAPS)) {
        let grid = Grid::new(page, SIDES[several]);
        let path = subject.path;
        let own = grid.patches(patches, k);
        // JPEG smears texels that are seen one by one.
        let encode = if grid.size[0] * grid.size[1] > MOST_DRAWN { photo } else { drawing };
        let draw = |color: &(dyn Fn(&[u32]) -> Rgb + Sync)| {
            let pixel = |cell: &Vec<u32>| if cell.is_empty() { [NEUTRAL; 3] } else { color(cell).to_array() };
            drawing(path, grid.size, &own.iter().map(pixel).collect::<Vec<_>>())
        };
        let mean = |values: &[f32], cell: &[u32]| {
            cell.iter().map(|&i| values[i as usize]).fold(0.0, |a, b| a + b) / cell.len() as f32
        };
        pages.push(MapPictures {
            light: encode(path, grid.size, &grid.light(page, exposure))?,
            charts: draw(&|cell| render::chart_color(patches.chart(cell[0] as usize)))?,
            density: draw(&|cell| scales[0].color(mean(&densities, cell)).into())?,
            noise: draw(&|cell| scales[1].color(mean(subject.noise, cell)).into())?,
            texels_per_pixel: grid.block,
        });
    }
    let noise = scales[1].legend(subject.noise.iter().copied());
    Ok(Maps { pages, density: scales[0].legend(densities.into_iter()), noise })
}

/// Squares of texels.
struct Grid {
    /// Side of a square [texels].
    block: u32,
    /// Squares across and down.
    size: [u32; 2],
}

impl Grid {
    fn new(page: &Page, side: u32) -> Self {
        let block = page.width.max(page.height).div_ceil(side).max(1);
        Self { block, size: [page.width.div_ceil(block), page.height.div_ceil(block)] }
    }

    /// The front patches in each square.
    fn patches(&self, patches: &Patches, page: u32) -> Vec<Vec<u32>> {
        let mut cells = vec![vec![]; self.size[0] as usize * self.size[1] as usize];
        for i in (0..patches.front).filter(|&i| patches.page(i) == page) {
            let (x, y) = patches.texel_xy(i);
            cells[(y / self.block * self.size[0] + x / self.block) as usize].push(i as u32);
        }
        cells
    }

    /// Linear display values of the light.
    fn light(&self, page: &Page, exposure: f32) -> Vec<[f32; 3]> {
        let [columns, rows] = self.size;
        parallel::map((columns * rows) as usize, |i| {
            let (column, row) = (i as u32 % columns, i as u32 / columns);
            let mut sums = [(Rgb::ZERO, 0.0f32); 2];
            for y in row * self.block..((row + 1) * self.block).min(page.height) {
                for x in column * self.block..((column + 1) * self.block).min(page.width) {
                    let [r, g, b, covered] = page.pixels[(y * page.width + x) as usize];
                    let color = Rgb::new(r, g, b);
                    let sum = &mut sums[usize::from(covered <= 0.0)];
                    if covered > 0.0 || color != Rgb::ZERO {
                        *sum = (sum.0 + color, sum.1 + 1.0);
                    }
                }
            }
            match sums.iter().find(|(_, count)| *count > 0.0) {
                Some((sum, count)) => render::tone(*sum / *count * exposure).to_array(),
                None => [NEUTRAL; 3],
            }
        })
    }
}

/// Factor that maps the log-average of the covered texels to [`KEY`]; 1 if all are black.
fn exposure(lightmap: &Lightmap) -> f32 {
    let lit = |p: &[f32; 4]| f64::from(luminance(Rgb::new(p[0], p[1], p[2]))).max(0.0) * f64::from(p[3] > 0.0);
    let over = |value: &(dyn Fn(f64) -> f64 + Sync)| {
        let of = |page: &Page| parallel::sum(page.pixels.len(), |i| value(lit(&page.pixels[i])));
        lightmap.pages.iter().map(of).fold(0.0, |a, b| a + b)
    };
    let (total, count) = (over(&|v| v), over(&|v| f64::from(v > 0.0)));
    if count == 0.0 {
        return 1.0;
    }
    // As in pictures of scenes: black corners would pull a logarithm down without end.
    let least = total / count * 1e-3;
    let (sum, count) = (over(&|v| if v > least { libm::log2(v) } else { 0.0 }), over(&|v| f64::from(v > least)));
    KEY * libm::exp2(-sum / count.max(1.0)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_the_mean_of_covered_texels_before_dilated_ones() {
        let mut pixels = vec![[0.0; 4]; 6];
        pixels[0] = [1.0, 1.0, 1.0, 1.0];
        pixels[1] = [9.0, 9.0, 9.0, 0.0];
        pixels[3] = [3.0, 3.0, 3.0, 1.0];
        let page = Page { width: 3, height: 2, pixels };
        let grid = Grid::new(&page, 2);
        assert_eq!((grid.block, grid.size), (2, [2, 1]));
        let light = grid.light(&page, 0.5);
        assert_eq!(light, [render::tone(Rgb::ONE).to_array(), [NEUTRAL; 3]]);
    }

    #[test]
    fn exposure_does_not_depend_on_the_level() {
        let at = |level: f32| {
            let pixels = vec![[level; 4], [2.0 * level, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0], [99.0, 0.0, 0.0, 0.0]];
            level * exposure(&Lightmap { pages: vec![Page { width: 4, height: 1, pixels }] })
        };
        assert!((at(0.01) / at(10.0) - 1.0).abs() < 1e-5 && at(1.0) > 0.0);
        assert_eq!(at(0.0), 0.0);
    }
}
