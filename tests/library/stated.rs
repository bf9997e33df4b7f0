//! Stated error: what sharing says is left of noise and blur, against what is left of it, where the truth is known.
//!
//! Light is a function of place that bends and jumps; its two halves have noise of known size. Both what is stated of all
//! texels together and what is expected of single ones is compared.

#![allow(clippy::print_stderr, reason = "figures of the slow tests")]

use crate::solve::{Stage, load};
use crate::support::stream;
use glam::Vec3;
use texelwalk::base::Rgb;
use texelwalk::finish::{self, Along, Ways};

/// Light that bends over metres, and jumps by half along a line that no border of a chart follows.
fn truth(p: Vec3) -> f32 {
    let smooth = 1.0 + 0.4 * libm::sinf(1.3 * p.x + 0.7 * p.z) + 0.3 * libm::cosf(0.9 * p.y - 0.5 * p.z);
    if p.x + 0.3 * p.z > 0.4 { 0.5 * smooth } else { smooth }
}

/// What was found beside what is stated, as roots of sums of squares over all texels; and the root mean square of what was
/// found over what is stated of single texels.
struct Found {
    raw: f64,
    left: f64,
    stated: f64,
    single: f64,
}

/// Shares light with noise of a standard deviation relative to the root of the light, as that of counted rays has it.
fn shared(stage: &Stage<'_>, noise: f32, seed: u64) -> Found {
    let n = stage.patches.front;
    let light: Vec<f32> = stage.patches.position[..n].iter().map(|p| truth(*p)).collect();
    let mut s = stream(seed);
    let mut normal = || (0..12).map(|_| s.next_f32()).sum::<f32>() - 6.0;
    // Of the mean of two halves it is that over √2.
    let mut half = || -> Vec<Rgb> {
        let one = |e: &f32| Rgb::splat(*e) + Rgb::from_array([normal(), normal(), normal()]) * (noise * e.sqrt());
        light.iter().map(one).collect()
    };
    let [mut a, mut b] = [half(), half()];
    let squared = |a: &[Rgb], b: &[Rgb]| -> Vec<f64> {
        let one = |i: usize| f64::from(((a[i] + b[i]) * 0.5 - Rgb::splat(light[i])).length_squared());
        (0..n).map(one).collect()
    };
    let raw = squared(&a, &b).iter().sum::<f64>().sqrt();
    let ways = Ways::new(&stage.patches, &stage.graph, n);
    let errors = finish::share(&stage.patches, ways.clone(), [&mut a, &mut b], Along::default());
    let left = squared(&a, &b);
    let expected = errors.expected(&stage.patches, &ways.network());
    let single = left.iter().zip(&expected).map(|(l, e)| l / f64::from(*e)).sum::<f64>() / n as f64;
    Found { raw, left: left.iter().sum::<f64>().sqrt(), stated: errors.sum_of(|_| true).sqrt(), single: single.sqrt() }
}

#[test]
fn what_is_stated_is_what_is_left_however_much_was_removed() {
    for (fixture, density) in [("office/office.glb", 10.0), ("two-rooms/two-rooms.glb", 10.0)] {
        let scene = load(fixture);
        let stage = Stage::new(&scene, density);
        for noise in [0.5, 0.1, 0.02] {
            let Found { raw, left, stated, single } = shared(&stage, noise, 5);
            let (gain, ratio) = (raw / left, stated / left);
            eprintln!("{fixture} {noise}: error / {gain:.2}, stated {ratio:.2}, single texels {single:.2}");
            assert!(gain > 1.3, "{fixture} {noise}: sharing removes little: {gain}");
            assert!((0.8..1.25).contains(&ratio), "{fixture} {noise}: stated {ratio} of what is left");
            assert!((0.6..1.4).contains(&single), "{fixture} {noise}: single texels {single}");
        }
    }
}
