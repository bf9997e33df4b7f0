//! Dim places next to bright ones get lines of their own.

use crate::solve::{Stage, square};
use crate::support;
use glam::DVec3;
use glam::Vec3;
use texelwalk::base::{Progress, Rgb};
use texelwalk::walk::{self, Splat};

#[test]
fn a_cellar_under_a_square_in_the_sun_has_all_of_its_light() {
    let mut cellar = vec![];
    support::cuboid(DVec3::new(-1.5, -3.0, -1.5), DVec3::new(1.5, -0.5, 1.5), 1, true, &mut cellar);
    let mut all: Vec<[Vec3; 3]> = cellar.iter().map(|t| t.map(|corner| corner.as_vec3())).collect();
    all.extend(square(Vec3::new(-8.0, 0.0, 8.0), Vec3::X * 16.0, Vec3::Z * -16.0));
    let mut scene = support::scene_from_triangles(&all);
    scene.materials[0].base_color = Rgb::splat(0.6).extend(1.0);
    let stage = Stage::new(&scene, 4.0);
    let p = &stage.patches;
    let is_inside = |i: usize| p.position[i].y < -0.1;
    let direct: Vec<Rgb> = (0..p.len())
        .map(|i| match (is_inside(i), p.normal[i].y > 0.9) {
            (false, _) => Rgb::splat(1e5),
            (true, true) => Rgb::splat(3.0),
            (true, false) => Rgb::ZERO,
        })
        .collect();
    let places = walk::places(&stage.tracer, p, &stage.graph, &Progress::default());
    let of = |inside: bool| {
        let mut of: Vec<u32> = (0..p.front).filter(|&i| is_inside(i) == inside).map(|i| places[i]).collect();
        of.sort_unstable();
        of.dedup();
        of
    };
    let ([cellar], [square]) = (&of(true)[..], &of(false)[..]) else { panic!("{:?}, {:?}", of(true), of(false)) };
    assert_ne!(cellar, square);

    let lines = 64 * p.len() as u64;
    let settings = |seed| walk::Settings { splat: Splat::None, lines, bounces: None, low_discrepancy: true, seed };
    // Light in a closed room is a series: what comes after reflections is direct · ρ/(1 − ρ).
    let expected = stage.mean(&direct, is_inside) * 0.6 / 0.4;
    for seed in 0..4 {
        let found = stage.walk_in((&places, None), Some(&direct), &settings(seed));
        let ratio = stage.mean(&found.indirect, is_inside) / expected;
        assert!((ratio - 1.0).abs() < 0.005, "{ratio} of the light");
        let left = found.ledger.last().unwrap();
        assert!(found.ledger.iter().map(|bounce| bounce.lines).sum::<u64>() <= lines && left.lines == 0);
        for bounce in &found.ledger {
            let to = bounce.received[0] + bounce.escaped[0] + bounce.culled[0];
            assert!((bounce.shot[0] - to).abs() <= 1e-5 * bounce.shot[0], "{bounce:?}");
        }
    }
    let together = stage.walk_in((&[], None), Some(&direct), &settings(0));
    assert!(stage.mean(&together.indirect, is_inside) < 0.8 * expected, "it would not have been noticed");
}
