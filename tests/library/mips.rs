//! Light at the borders of charts in mip levels and in blocks of compressed textures: none of it comes from other charts.
//!
//! Judged is a bake as loaders see it: the EXR, and which texels a chart covers, from the layer `chart`. Mip levels and
//! look-ups are made here anew. At points all over every texel at a chart's border, a look-up may give anything between
//! the least and the most that the chart's own texels have around there, those that bilinear look-ups read beside it
//! included: so a gradient of light is no fault. What lies outside of that range is light of other charts, or of none.

#![allow(clippy::print_stderr, reason = "figures of the slow tests")]

use block_compression::encode::compress_rgba16;
use block_compression::{BC6HSettings, CompressionVariant, decode};
use exr::prelude::{ReadChannels, ReadLayers};
use half::f16;
use std::path::Path;
use std::process::Command;
use texelwalk::output::exr::read_rgba;

/// Mip levels that are asked for and judged.
const LEVELS: u32 = 3;

/// One channel of a picture; row 0 on top.
#[derive(Clone)]
struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    fn at(&self, x: i64, y: i64) -> f32 {
        let x = x.clamp(0, self.width as i64 - 1) as usize;
        let y = y.clamp(0, self.height as i64 - 1) as usize;
        self.values[y * self.width + x]
    }

    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |i: usize| {
            let (x, y) = ((2 * (i % width)) as i64, (2 * (i / width)) as i64);
            0.25 * (self.at(x, y) + self.at(x + 1, y) + self.at(x, y + 1) + self.at(x + 1, y + 1))
        };
        Self { width, height, values: (0..width * height).map(mean).collect() }
    }

    fn look_up(&self, x: f32, y: f32) -> f32 {
        let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
        let (fx, fy) = (x - 0.5 - left, y - 0.5 - top);
        let at = |dx: i64, dy: i64| self.at(left as i64 + dx, top as i64 + dy);
        let row = |dy: i64| at(0, dy) * (1.0 - fx) + at(1, dy) * fx;
        row(0) * (1.0 - fy) + row(1) * fy
    }

    /// What is left of it after compression to blocks of BC6H; all channels are the same.
    fn compressed(&self) -> Self {
        let size = [self.width, self.height].map(|n| n as u32);
        let texels: Vec<f16> = self
            .values
            .iter()
            .flat_map(|v| [f16::from_f32(*v), f16::from_f32(*v), f16::from_f32(*v), f16::ONE])
            .collect();
        let variant = CompressionVariant::BC6H(BC6HSettings::basic());
        let mut blocks = vec![0; self.width * self.height];
        compress_rgba16(variant, &texels, &mut blocks, size[0], size[1], size[0] * 4);
        let mut back = self.clone();
        for (k, block) in blocks.chunks(16).enumerate() {
            let (left, top) = (k % (self.width / 4) * 4, k / (self.width / 4) * 4);
            let mut rgb = [0.0f32; 48];
            decode::decode_block_bc6h_float(block, &mut rgb, 12, false);
            for i in 0..16 {
                back.values[(top + i / 4) * self.width + left + i % 4] = rgb[3 * i];
            }
        }
        back
    }
}

/// The first page of a bake.
struct Baked {
    red: Plane,
    /// Chart of every texel, from 1; 0 where none lies, or only hidden surface.
    chart: Plane,
    mean: f32,
}

fn bake(name: &str, options: &[&str]) -> Baked {
    let home = tempfile::tempdir().unwrap();
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name);
    let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    command.arg("bake").arg(input).arg("-o").arg(home.path().join("out.glb")).args(["--aov", "chart", "-q"]);
    command.args(["--preset", "preview", "--texels-per-meter", "16", "--page-size", "2048"]);
    command.args(["--gather", "8", "--direct-samples", "2"]).args(options);
    let out = command.output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let page = read_rgba(&home.path().join("out.lightmap0.exr")).unwrap();
    let layers = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let layers = layers.all_attributes().from_file(home.path().join("out.aov0.exr")).unwrap();
    let chart = layers.layer_data.channel_data.list.iter().find(|c| c.name.to_string() == "chart.Y").unwrap();
    let plane = |values: Vec<f32>| Plane { width: page.width as usize, height: page.height as usize, values };
    let covered: Vec<f32> = page.pixels.iter().filter(|p| p[3] > 0.0).map(|p| p[0]).collect();
    Baked {
        red: plane(page.pixels.iter().map(|p| p[0]).collect()),
        chart: plane(chart.sample_data.values_as_f32().collect()),
        mean: covered.iter().map(|v| v / covered.len() as f32).fold(0.0, |a, b| a + b),
    }
}

impl Baked {
    /// Texels at the borders of charts, every third of them.
    fn border(&self) -> Vec<(i64, i64)> {
        let (width, height) = (self.chart.width as i64, self.chart.height as i64);
        let all = (0..width * height).map(|i| (i % width, i / width));
        let own = |(x, y): (i64, i64)| self.chart.at(x, y);
        all.filter(|t| own(*t) > 0.0 && around(*t, 1).any(|u| own(u) != own(*t))).step_by(3).collect()
    }

    /// Least and most of the chart's own light within `reach` texels, and of the texels next to these that no other chart
    /// covers.
    fn range(&self, texel: (i64, i64), reach: i64) -> (f32, f32) {
        let chart = self.chart.at(texel.0, texel.1);
        let is_own = |(x, y): (i64, i64)| self.chart.at(x, y) == chart;
        let beside = |(x, y): (i64, i64)| self.chart.at(x, y) == 0.0 && around((x, y), 1).any(is_own);
        let own = around(texel, reach).filter(|t| is_own(*t) || beside(*t)).map(|(x, y)| self.red.at(x, y));
        own.fold((f32::INFINITY, 0.0), |(low, high), v| (low.min(v), high.max(v)))
    }

    /// How far look-ups at a border texel in a mip level lie outside of the chart's own range, as a part of its light.
    fn foreign(&self, level: &Plane, k: u32, (x, y): (i64, i64)) -> f32 {
        let (low, high) = self.range((x, y), 4 << k);
        let scale = (0.5 * (low + high)).max(0.02 * self.mean);
        let side = (1 << k) as f32;
        let outside = |i: u32| {
            let [px, py] = [(x, i % 3), (y, i / 3)].map(|(t, k)| (t as f32 + 0.5 * k as f32) / side);
            let found = level.look_up(px, py);
            (low - found).max(found - high).max(0.0) / scale
        };
        (0..9).map(outside).fold(0.0, f32::max)
    }

    /// The worst look-up of each border texel in levels 1 to 3, sorted.
    fn bleeding(&self) -> [Vec<f32>; LEVELS as usize] {
        let border = self.border();
        let mut level = self.red.clone();
        [1, 2, 3].map(|k| {
            level = level.halved();
            let mut all: Vec<f32> = border.iter().map(|t| self.foreign(&level, k, *t)).collect();
            all.sort_by(f32::total_cmp);
            all
        })
    }

    /// What compression to blocks changes in look-ups at border texels: difference over light, less `gradient` times the
    /// range of the chart's own light within a block's reach; sorted.
    fn block_errors(&self, gradient: f32) -> Vec<f32> {
        let compressed = self.red.compressed();
        let one = |&(x, y): &(i64, i64)| {
            let (low, high) = self.range((x, y), 8);
            let scale = (0.5 * (low + high)).max(0.02 * self.mean);
            let error = |i: u32| {
                let [px, py] = [(x, i % 3), (y, i / 3)].map(|(t, k)| t as f32 + 0.5 * k as f32);
                (self.red.look_up(px, py) - compressed.look_up(px, py)).abs() - gradient * (high - low)
            };
            (0..9).map(error).fold(0.0, f32::max) / scale
        };
        let mut all: Vec<f32> = self.border().iter().map(one).collect();
        all.sort_by(f32::total_cmp);
        all
    }
}

fn around((x, y): (i64, i64), reach: i64) -> impl Iterator<Item = (i64, i64)> {
    (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| (x + dx, y + dy)))
}

fn percentile(sorted: &[f32], part: f64) -> f32 {
    sorted[((sorted.len() as f64 * part) as usize).min(sorted.len() - 1)]
}

const CORNELL: &str = "cornell/cornell.gltf";
const OFFICE: &str = "office/office.glb";

#[test]
fn three_levels_hold_no_light_of_other_charts() {
    for name in [CORNELL, OFFICE] {
        let clean = bake(name, &["--mips", "3"]).bleeding();
        for (k, errors) in clean.iter().enumerate() {
            eprintln!(
                "{name}: {} look-ups, level {}: at most {:.4} outside",
                errors.len(),
                k + 1,
                percentile(errors, 1.0)
            );
            assert!(errors.len() > 1000 && percentile(errors, 1.0) <= 0.01, "{name}, level {}", k + 1);
        }
    }
    // The measure finds what it looks for: without clean levels charts do mix.
    let mixed = bake(CORNELL, &["--mips", "0", "--padding", "2"]).bleeding();
    let found = mixed.map(|errors| percentile(&errors, 0.9));
    eprintln!("without clean levels, 90th percentiles: {found:.3?}");
    assert!(found[1] > 0.05 && found[2] > 0.05);
}

#[test]
fn one_level_is_clean_where_one_is_asked_for() {
    let levels = bake(CORNELL, &["--mips", "1"]).bleeding();
    let worst = levels.map(|errors| percentile(&errors, 1.0));
    eprintln!("one clean level: {worst:.4?}");
    assert!(worst[0] <= 0.01 && worst[2] > 0.2);
}

#[test]
fn blocks_of_four_texels_keep_the_light_at_borders() {
    // A block has a few bits per texel for all that is in it: where the chart's own light is steep, that shows.
    const GRADIENT: f32 = 0.2;
    let plain = |name: &str, mips: &str| {
        let baked = bake(name, &["--mips", mips]);
        let (plain, errors) = (baked.block_errors(0.0), baked.block_errors(GRADIENT));
        let at = |errors: &[f32]| [0.5, 0.99, 0.999, 1.0].map(|p| percentile(errors, p));
        eprintln!("{name}, {mips} levels: {:.4?}; without allowance {:.4?}", at(&errors), at(&plain));
        if mips != "0" {
            assert!(percentile(&errors, 0.99) <= 0.01, "{name}");
        }
        percentile(&plain, 0.99)
    };
    plain(OFFICE, "3");
    // Blocks that hold two charts are worse by far.
    let [clean, mixed] = ["3", "0"].map(|mips| plain(CORNELL, mips));
    assert!(mixed > 2.0 * clean, "{mixed} {clean}");
}
