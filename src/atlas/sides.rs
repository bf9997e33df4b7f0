//! The page that a layout was made for, by the shape and size of its triangles.
//!
//! In: triangles, in the world and in the layout. Out: lengths of the world along the sides of the page. Coordinates run from
//! 0 to 1 over both, so on a page that is not square, as most that are made here, a step in u is another length than one in
//! v. A layout of 292 × 124 texels that was kept as if for a square had texels of 0.185 × 0.079 m.
//!
//! Symbols, in this file only: P(u, v) is the surface; ∂P/∂u and ∂P/∂v are its derivatives [m].

use super::flatten::twice_area;
use crate::base::percentile::percentile;
use glam::{DVec2, DVec3};

/// Triangles whose proportions or sizes differ by less are of one page.
const EQUAL: f64 = 0.02;
/// Longer pages are not believed in: what was pressed together is no layout.
const LONGEST: f64 = 16.0;

/// Width and height of the page [m]; `None` for layouts without an area, in the world or in the plane.
///
/// The proportions are the median of |∂P/∂u| over |∂P/∂v| by area, if most of it has it and it is that of a page; else a
/// square's. The size is such that the density is 1 in the mean, or for most of the area, if that is nearly the same: specks
/// that have more of a texel than they need shall not change it.
pub(super) fn page(worlds: &[[DVec3; 3]], corners: &[[DVec2; 3]]) -> Option<DVec2> {
    let areas = || worlds.iter().zip(corners).map(|(world, flat)| (area(world), 0.5 * twice_area(*flat).abs()));
    let (all, flat) = areas().fold((0.0, 0.0), |sum, (area, flat)| (sum.0 + area, sum.1 + flat));
    let mean = (all / flat).sqrt();
    if !(mean.is_finite() && mean > 0.0) {
        return None;
    }
    let ratios = worlds.iter().zip(corners).map(|(world, flat)| (ratio(world, flat), area(world)));
    let wide = common(ratios).filter(|ratio| (1.0 / LONGEST..=LONGEST).contains(ratio)).unwrap_or(1.0).sqrt();
    let sizes = areas().map(|(area, flat)| ((area / flat).sqrt(), area));
    let size = common(sizes).filter(|size| (size / mean).ln().abs() < EQUAL).unwrap_or(mean);
    Some(DVec2::new(size * wide, size / wide))
}

/// The median of values by weight, if half of the weight has about that. What is no positive number does not count.
fn common(values: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let mut values: Vec<(f64, f64)> = values.filter(|(value, _)| value.is_finite() && *value > 0.0).collect();
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let median = percentile(&values, 0.5)?;
    let (mut all, mut equal) = (0.0, 0.0);
    for (value, weight) in values {
        all += weight;
        equal += if (value / median).ln().abs() < EQUAL { weight } else { 0.0 };
    }
    (equal >= 0.5 * all).then_some(median)
}

/// |∂P/∂u| over |∂P/∂v| of a triangle; NaN or infinite where it has none.
fn ratio(world: &[DVec3; 3], flat: &[DVec2; 3]) -> f64 {
    let (e1, e2) = (world[1] - world[0], world[2] - world[0]);
    let (d1, d2) = (flat[1] - flat[0], flat[2] - flat[0]);
    let (along_u, along_v) = (e1 * d2.y - e2 * d1.y, e2 * d1.x - e1 * d2.x);
    if twice_area(*flat) == 0.0 { f64::NAN } else { along_u.length() / along_v.length() }
}

/// Of a triangle [m²].
fn area(world: &[DVec3; 3]) -> f64 {
    0.5 * (world[1] - world[0]).cross(world[2] - world[0]).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of a unit circle's plane, turned by all angles, as a page of this size has them.
    fn turned(page: DVec2, n: usize) -> (Vec<[DVec3; 3]>, Vec<[DVec2; 3]>) {
        let triangle = |k: usize| {
            let turn = DVec2::from_angle(k as f64);
            [DVec2::ZERO, DVec2::new(0.3, 0.0), DVec2::new(0.1, 0.2)].map(|p| turn.rotate(p))
        };
        let flat: Vec<[DVec2; 3]> = (0..n).map(triangle).collect();
        let worlds = flat.iter().map(|t| t.map(|p| DVec3::new(p.x, 2.0, p.y))).collect();
        (worlds, flat.iter().map(|t| t.map(|p| p / page)).collect())
    }

    fn is_near(found: DVec2, page: DVec2) -> bool {
        (found / page - 1.0).abs().max_element() < 1e-9
    }

    #[test]
    fn a_page_has_the_sides_that_make_its_texels_square() {
        for page in [DVec2::ONE, DVec2::new(292.0, 124.0), DVec2::new(1.0, 1.003)] {
            let (worlds, flat) = turned(page, 40);
            assert!(is_near(super::page(&worlds, &flat).unwrap(), page), "{page}");
        }
    }

    #[test]
    fn specks_do_not_change_its_size_and_layouts_of_several_densities_have_the_mean() {
        let sides = DVec2::new(8.0, 4.0);
        let (worlds, mut flat) = turned(sides, 100);
        flat[0].iter_mut().for_each(|p| *p *= 0.1);
        assert!(is_near(page(&worlds, &flat).unwrap(), sides));
        flat[40..].iter_mut().flatten().for_each(|p| *p *= 0.5);
        let mean = (100.0 / (0.01 + 39.0 + 15.0f64)).sqrt();
        assert!(is_near(page(&worlds, &flat).unwrap(), sides * mean));
    }

    #[test]
    fn what_has_no_common_proportions_is_of_a_square() {
        let square = |page: Option<DVec2>| page.is_some_and(|page| page.x == page.y);
        let (worlds, mut flat) = turned(DVec2::ONE, 40);
        flat.iter_mut().enumerate().for_each(|(k, t)| t.iter_mut().for_each(|p| p.x *= 1.0 + 0.1 * k as f64));
        assert!(square(page(&worlds, &flat)));
        let (worlds, pressed) = turned(DVec2::new(1.0, 50.0), 40);
        assert!(square(page(&worlds, &pressed)));
        assert_eq!(page(&[], &[]), None);
        let (worlds, flat) = (vec![[DVec3::ZERO; 3]], vec![[DVec2::ZERO; 3]]);
        assert_eq!(page(&worlds, &flat), None);
    }
}
