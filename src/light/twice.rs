//! Glowing triangles that are there twice, in the same place with the same side as front: one of them counts, the one that
//! rays meet.
//!
//! In: scene and triangles, ascending. Out: those that count, ascending. A lamp whose mesh was there twice gave twice the
//! light.
//!
//! Limit: the same corners, bit by bit. Glowing surfaces that overlap otherwise in one plane all count.

use crate::scene::Scene;
use glam::Vec3;
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Corners by their bits, the smallest first, in their order around the front.
type Key = [[u32; 3]; 3];

pub(super) fn once(scene: &Scene, triangles: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut known: HashMap<Key, bool> = HashMap::new();
    let is_first = |triangle: &u32| {
        let two_sided = scene.material(*triangle).is_two_sided();
        match known.entry(key(scene.corners(*triangle))) {
            Entry::Vacant(entry) => {
                entry.insert(two_sided);
                true
            }
            // The back of the first one does not glow.
            Entry::Occupied(mut entry) => two_sided && !entry.insert(true),
        }
    };
    triangles.filter(is_first).collect()
}

fn key(corners: [Vec3; 3]) -> Key {
    // −0 and 0 are one place.
    let [a, b, c] = corners.map(|corner| (corner + 0.0).to_array().map(f32::to_bits));
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap_or([a, b, c])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_know_places_and_sides() {
        let [a, b, c] = [Vec3::ZERO, Vec3::new(-0.0, 1.0, 0.0), Vec3::new(1.0, -0.0, -2.0)];
        assert_eq!(key([a, b, c]), key([b, c, a]));
        assert_eq!(key([a, b, c]), key([-a, Vec3::Y, Vec3::new(1.0, 0.0, -2.0)]));
        assert_ne!(key([a, b, c]), key([a, c, b]));
        assert_ne!(key([a, b, c]), key([a, b, Vec3::ONE]));
    }
}
