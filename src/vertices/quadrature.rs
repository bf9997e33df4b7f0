//! Integrals over a triangle, as sums over its pieces in texels.
//!
//! In: a triangle on its page, patches, the lightmap. Out: points with their barycentric weights, light and area. A
//! whole texel gets the 2 × 2 points of Gauss, a clipped one the three points of each triangle of its fan that are exact
//! for quadratic functions. So products of two hat functions are exact, and the same points serve both sides of the
//! normal equations: linear light is reproduced exactly, whatever is hidden.
//!
//! Points that lie inside other solids, by the cell of the exposure mask, are left out.

use super::mesh::Element;
use crate::atlas::raster::Polygon;
use crate::atlas::raster::cover;
use crate::base::bilinear::bilinear;
use crate::finish::Lightmap;
use crate::patches::Patches;
use glam::DVec2;
use glam::DVec3;

/// 1/2 ± 1/(2√3): Gauss's two points.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// Covered part of a texel from which it counts as whole.
const WHOLE: f64 = 0.999_999;

/// What is integrated.
pub(super) struct Field<'a> {
    pub(super) patches: &'a Patches,
    pub(super) lightmap: &'a Lightmap,
}

/// A point of a triangle.
pub(super) struct Point {
    /// Values of the three hat functions.
    pub(super) hats: [f64; 3],
    /// Light there, in the unit of the lightmap.
    pub(super) light: DVec3,
    /// [m²]
    pub(super) area: f64,
}

impl Field<'_> {
    /// Calls `visit` for every point of an element that is exposed.
    pub(super) fn visit(&self, element: &Element, mut visit: impl FnMut(&Point)) {
        let doubled = element.doubled_texels();
        if !element.is_charted() || doubled == 0.0 {
            return;
        }
        let scale = element.area / (0.5 * doubled.abs());
        let [a, b, c] = element.uv;
        cover(element.uv.map(|p| p.as_vec2()), |x, y, polygon| {
            let Some(patch) = self.patches.front_at(element.page, x, y) else { return };
            let corner = DVec2::new(f64::from(x), f64::from(y));
            points(polygon, |local, texels| {
                if self.patches.is_exposed_at(patch, local) {
                    let at = corner + local;
                    let hats = [(b - at).perp_dot(c - at), (c - at).perp_dot(a - at), (a - at).perp_dot(b - at)];
                    let light = self.light(element.page, at);
                    visit(&Point { hats: hats.map(|h| h / doubled), light, area: texels * scale });
                }
            });
        });
    }

    /// The lightmap as a renderer shows it, at a place in texels.
    pub(super) fn light(&self, page: u32, at: DVec2) -> DVec3 {
        let page = &self.lightmap.pages[page as usize];
        bilinear(page.width, page.height, &page.pixels, at.as_vec2()).as_dvec3()
    }
}

/// Calls `visit(point, weight [texel²])` for points of a polygon within a texel.
fn points(polygon: &Polygon, mut visit: impl FnMut(DVec2, f64)) {
    if polygon.area() > WHOLE {
        GAUSS.iter().for_each(|&y| GAUSS.iter().for_each(|&x| visit(DVec2::new(x, y), 0.25)));
        return;
    }
    let corners = polygon.corners();
    for k in 2..corners.len() {
        let [a, b, c] = [corners[0], corners[k - 1], corners[k]];
        let third = (b - a).perp_dot(c - a).abs() / 6.0;
        if third > 0.0 {
            for [p, q, r] in [[a, b, c], [b, c, a], [c, a, b]] {
                visit(p * (2.0 / 3.0) + (q + r) / 6.0, third);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadratic_functions_are_integrated_exactly() {
        let f = |p: DVec2| 1.0 + 2.0 * p.x - p.y + 3.0 * p.x * p.y + p.x * p.x;
        let mut whole = 0.0;
        let mut add = |corners: [[f32; 2]; 3]| {
            cover(corners.map(Into::into), |_, _, polygon| points(polygon, |p, w| whole += w * f(p)));
        };
        add([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]);
        add([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        let exact = 1.0 + 1.0 - 0.5 + 0.75 + 1.0 / 3.0;
        assert!((whole - exact).abs() < 1e-12, "{whole} {exact}");
        let mut gauss = 0.0;
        GAUSS.iter().for_each(|&y| GAUSS.iter().for_each(|&x| gauss += 0.25 * f(DVec2::new(x, y))));
        assert!((gauss - exact).abs() < 1e-12);
    }
}
