//! What coloured solids take from light along a ray (`KHR_materials_volume`).
//!
//! In: the crossings of a ray with surfaces that have a volume. Out: the share of light that is left.
//!
//! A part whose triangles close it is a solid: what counts is the way between entry and exit, from the start of the ray
//! where it begins inside, to its end where it ends inside. Any other part is a sheet: it takes what its material's
//! thickness takes, at any angle, as viewers do that know nothing behind the surface.
//!
//! What is closed is told by `closed`. Solids that are inside out are turned. A ray through an edge may meet both of its
//! triangles: an entry after an entry, and an exit after an exit, does not count.
//!
//! Limits: a solid must be one primitive; two bodies of one part that go through each other count as one from the first entry
//! to the first exit.

use super::closed::closes;
use super::crossings::Crossed;
use super::{Ray3, Tracer};
use crate::base::Rgb;
use crate::scene::{Part, Scene};

/// What a part is to light that passes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Body {
    /// Its material has no volume.
    Hollow,
    Sheet,
    Solid,
    /// A solid whose fronts look inward.
    InsideOut,
}

/// By part; empty if no material in use has a volume.
pub(super) fn bodies(scene: &Scene) -> Vec<Body> {
    let has_volume = |part: &Part| scene.materials[part.material].volume.is_some();
    if !scene.parts.iter().any(has_volume) {
        return vec![];
    }
    scene.parts.iter().map(|part| if has_volume(part) { body(scene, part) } else { Body::Hollow }).collect()
}

fn body(scene: &Scene, part: &Part) -> Body {
    let triangles: Vec<u32> = part.triangles.clone().collect();
    let six_volumes = |t: &u32| {
        let [a, b, c] = scene.corners(*t).map(|p| p.as_dvec3());
        a.dot(b.cross(c))
    };
    let volume = triangles.iter().map(six_volumes).fold(0.0, |a, b| a + b);
    match (volume != 0.0 && closes(scene, &triangles), volume < 0.0) {
        (false, _) => Body::Sheet,
        (true, false) => Body::Solid,
        (true, true) => Body::InsideOut,
    }
}

/// A crossing with the surface of a solid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wall {
    part: u32,
    t: f32,
    entry: bool,
}

impl Tracer<'_> {
    /// What a crossing takes by itself; those of solids are put to `walls`.
    pub(super) fn cross(&self, crossed: &Crossed, walls: &mut Vec<Wall>) -> Rgb {
        if self.bodies.is_empty() {
            return Rgb::ONE;
        }
        let index = self.scene.part_index(crossed.triangle);
        let part = index as u32;
        match self.bodies.get(index) {
            None | Some(Body::Hollow) => return Rgb::ONE,
            Some(Body::Sheet) => return self.scene.sheet_transmittance(crossed.triangle, crossed.weights()),
            Some(Body::Solid) => walls.push(Wall { part, t: crossed.t, entry: crossed.front }),
            Some(Body::InsideOut) => walls.push(Wall { part, t: crossed.t, entry: !crossed.front }),
        }
        Rgb::ONE
    }

    /// What the ways inside of solids leave.
    pub(super) fn left_by_solids(&self, ray: &Ray3, walls: &mut [Wall]) -> Rgb {
        walls.sort_unstable_by(|a, b| a.part.cmp(&b.part).then(a.t.total_cmp(&b.t)).then(a.entry.cmp(&b.entry)));
        let metres = ray.direction.length();
        let mut left = Rgb::ONE;
        for walls in walls.chunk_by(|a, b| a.part == b.part) {
            let material = &self.scene.materials[self.scene.parts[walls[0].part as usize].material];
            if let Some(volume) = &material.volume {
                left *= volume.left_after((f64::from(inside(walls, ray.t_max)) * metres) as f32);
            }
        }
        left
    }
}

/// Sum of the ways inside a solid, in units of the ray's direction; `walls` by distance.
fn inside(walls: &[Wall], t_max: f32) -> f32 {
    let mut sum = 0.0;
    // Where the way inside began; a ray that begins with an exit began inside.
    let mut since = (!walls[0].entry).then_some(0.0);
    for wall in walls {
        match (wall.entry, since) {
            (true, None) => since = Some(wall.t),
            (false, Some(start)) => {
                sum += wall.t - start;
                since = None;
            }
            _ => {}
        }
    }
    // A way without end is a gap that rounding left in the surface.
    since.filter(|_| t_max.is_finite()).map_or(sum, |start| sum + t_max - start)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_inside_add_up() {
        let wall = |t: f32, entry: bool| Wall { part: 0, t, entry };
        let (entry, exit) = (|t| wall(t, true), |t| wall(t, false));
        assert_eq!(inside(&[entry(1.0), exit(3.0), entry(5.0), exit(6.0)], f32::INFINITY), 3.0);
        assert_eq!(inside(&[exit(3.0), entry(5.0), exit(6.0)], f32::INFINITY), 4.0);
        assert_eq!(inside(&[entry(5.0)], 8.0), 3.0);
        assert_eq!(inside(&[entry(5.0)], f32::INFINITY), 0.0);
        // Both triangles of an edge.
        assert_eq!(inside(&[entry(1.0), entry(1.0), exit(3.0), exit(3.0)], 9.0), 2.0);
    }
}
