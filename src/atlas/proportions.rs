//! Proportions of the page that a layout was made for, by the shape of its triangles.
//!
//! In: triangles, in the world and in the layout. Out: width over height. Coordinates run from 0 to 1 over both sides of
//! a page, so on a page that is not square, as most that are made here, a step in u is another length than one in v. A
//! layout of 292 × 124 texels that was kept as if for a square had texels of 0.185 × 0.079 m.
//!
//! Symbols, in this file only: P(u, v) is the surface; ∂P/∂u and ∂P/∂v are its derivatives [m].

use super::flatten::twice_area;
use crate::base::percentile::percentile;
use glam::{DVec2, DVec3};

/// Triangles whose proportions differ by less are of one page.
const EQUAL: f64 = 0.02;
/// Longer pages are not believed in: what was pressed together is no layout.
const LONGEST: f64 = 16.0;

/// The median of |∂P/∂u| over |∂P/∂v| by area, if at least half of the area has it and it is that of a page; else 1, as for
/// empty layouts.
pub(super) fn proportions(worlds: &[[DVec3; 3]], corners: &[[DVec2; 3]]) -> f64 {
    let mut ratios: Vec<(f64, f64)> =
        worlds.iter().zip(corners).filter_map(|(world, flat)| ratio(world, flat)).collect();
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(median) = percentile(&ratios, 0.5) else { return 1.0 };
    let (mut all, mut equal) = (0.0, 0.0);
    for (ratio, area) in ratios {
        all += area;
        equal += if (ratio / median).ln().abs() < EQUAL { area } else { 0.0 };
    }
    if equal >= 0.5 * all && (1.0 / LONGEST..=LONGEST).contains(&median) { median } else { 1.0 }
}

/// |∂P/∂u| over |∂P/∂v| of a triangle, and its area [m²]; `None` where it has none.
fn ratio(world: &[DVec3; 3], flat: &[DVec2; 3]) -> Option<(f64, f64)> {
    let (e1, e2) = (world[1] - world[0], world[2] - world[0]);
    let (d1, d2) = (flat[1] - flat[0], flat[2] - flat[0]);
    let (along_u, along_v) = (e1 * d2.y - e2 * d1.y, e2 * d1.x - e1 * d2.x);
    let ratio = along_u.length() / along_v.length();
    let area = 0.5 * e1.cross(e2).length();
    (twice_area(*flat) != 0.0 && ratio > 0.0 && ratio.is_finite()).then_some((ratio, area))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of a unit circle's plane, turned by all angles, as a page of these proportions has them.
    fn turned(page: DVec2, n: usize) -> (Vec<[DVec3; 3]>, Vec<[DVec2; 3]>) {
        let triangle = |k: usize| {
            let turn = DVec2::from_angle(k as f64);
            [DVec2::ZERO, DVec2::new(0.3, 0.0), DVec2::new(0.1, 0.2)].map(|p| turn.rotate(p))
        };
        let flat: Vec<[DVec2; 3]> = (0..n).map(triangle).collect();
        let worlds = flat.iter().map(|t| t.map(|p| DVec3::new(p.x, 2.0, p.y))).collect();
        (worlds, flat.iter().map(|t| t.map(|p| p / page)).collect())
    }

    #[test]
    fn a_page_has_the_proportions_that_make_its_texels_square() {
        for page in [DVec2::ONE, DVec2::new(292.0, 124.0), DVec2::new(1.0, 1.003)] {
            let (worlds, flat) = turned(page, 40);
            assert!((proportions(&worlds, &flat) * page.y / page.x - 1.0).abs() < 1e-9, "{page}");
        }
    }

    #[test]
    fn what_has_no_common_proportions_is_left_alone() {
        let (worlds, mut flat) = turned(DVec2::ONE, 40);
        flat.iter_mut().enumerate().for_each(|(k, t)| t.iter_mut().for_each(|p| p.x *= 1.0 + 0.1 * k as f64));
        assert_eq!(proportions(&worlds, &flat), 1.0);
        let (worlds, pressed) = turned(DVec2::new(1.0, 50.0), 40);
        assert_eq!(proportions(&worlds, &pressed), 1.0);
        assert_eq!(proportions(&[], &[]), 1.0);
        let (worlds, flat) = (vec![[DVec3::ZERO; 3]], vec![[DVec2::ZERO; 3]]);
        assert_eq!(proportions(&worlds, &flat), 1.0);
    }
}
