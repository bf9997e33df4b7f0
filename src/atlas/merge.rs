//! Joins neighbouring charts that flatten well together: heals the cuts between chunks, and leaves fewer seams.
//!
//! In rounds: every chart takes part in at most one merge per round, best pairs first, so a smooth surface of n faces in c
//! chunks costs O(n log c). A pair is good where its common border is a large share of the smaller one's outline.

use super::flatten;
use super::flatten::Flat;
use super::weld::NONE;
use super::weld::Surface;
use crate::base::parallel;
use std::collections::HashSet;

/// Common border over outline of the smaller chart, below which the union would be held together by a thread.
const LEAST_SHARE: f64 = 0.12;

/// A chart's place in the list of charts is its number; 0 faces = merged away.
pub(super) fn merge(surface: &Surface, flats: Vec<Flat>) -> Vec<Flat> {
    if flats.len() < 2 {
        return flats;
    }
    let mut charts: Vec<Option<Flat>> = flats.into_iter().map(Some).collect();
    // A chart that changed gets a new version, so that pairs that failed are not tried again while both stay the same.
    let mut version = vec![0u32; charts.len()];
    let mut failed: HashSet<(u32, u32, u32, u32)> = HashSet::new();
    loop {
        let mut busy = vec![false; charts.len()];
        let mut tries = Vec::new();
        for (a, b) in pairs(surface, &charts) {
            let key = (a, b, version[a as usize], version[b as usize]);
            if !busy[a as usize] && !busy[b as usize] && !failed.contains(&key) {
                busy[a as usize] = true;
                busy[b as usize] = true;
                tries.push(key);
            }
        }
        if tries.is_empty() {
            return charts.into_iter().flatten().collect();
        }
        let unions = parallel::map(tries.len(), |i| {
            let (a, b) = (charts[tries[i].0 as usize].as_ref()?, charts[tries[i].1 as usize].as_ref()?);
            let mut faces = [a.faces.as_slice(), b.faces.as_slice()].concat();
            faces.sort_unstable();
            flatten::project(surface, &faces)
        });
        for (key, union) in tries.into_iter().zip(unions) {
            match union {
                Some(flat) => {
                    charts[key.0 as usize] = Some(flat);
                    charts[key.1 as usize] = None;
                    version[key.0 as usize] += 1;
                }
                None => {
                    failed.insert(key);
                }
            }
        }
    }
}

/// Pairs of charts worth a try, best first.
fn pairs(surface: &Surface, charts: &[Option<Flat>]) -> Vec<(u32, u32)> {
    let mut chart_of = std::collections::HashMap::new();
    for (c, flat) in charts.iter().enumerate() {
        for f in flat.iter().flat_map(|flat| &flat.faces) {
            chart_of.insert(*f, c as u32);
        }
    }
    let mut outline = vec![0.0; charts.len()];
    let mut borders: Vec<(u32, u32, u32, f64)> = Vec::new();
    for (c, flat) in charts.iter().enumerate() {
        for f in flat.iter().flat_map(|flat| &flat.faces) {
            for k in 0..3 {
                let g = surface.neighbor[*f as usize][k];
                let other = if g == NONE { None } else { chart_of.get(&g).copied() };
                if other == Some(c as u32) {
                    continue;
                }
                let length = surface.edge_length(*f, k);
                outline[c] += length;
                if let Some(other) = other
                    && surface.soft[*f as usize][k]
                    && other > c as u32
                {
                    borders.push((c as u32, other, *f, length));
                }
            }
        }
    }
    borders.sort_by(|a, b| (a.0, a.1, a.2).cmp(&(b.0, b.1, b.2)).then(a.3.total_cmp(&b.3)));
    let mut scored: Vec<(f64, u32, u32)> = borders
        .chunk_by(|x, y| (x.0, x.1) == (y.0, y.1))
        .map(|group| {
            let (a, b) = (group[0].0, group[0].1);
            let common: f64 = group.iter().map(|border| border.3).sum();
            (common / outline[a as usize].min(outline[b as usize]), a, b)
        })
        .filter(|(share, _, _)| *share >= LEAST_SHARE)
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    scored.into_iter().map(|(_, a, b)| (a, b)).collect()
}
