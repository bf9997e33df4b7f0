//! Joins neighbouring charts that flatten well together: heals the cuts between chunks, and leaves fewer seams.
//!
//! In rounds: every chart takes part in at most one merge per round, best pairs first, so a smooth surface of n faces
//! in c chunks costs O(n log c). A pair is good where its common border is a large share of the smaller one's outline.

use super::flatten;
use super::flatten::Flat;
use super::weld::NONE;
use super::weld::Surface;
use crate::base::parallel;
use glam::DVec3;
use std::collections::HashMap;
use std::collections::HashSet;

/// Common border over outline of the smaller chart, below which the union would be held together by a thread.
const LEAST_SHARE: f64 = 0.12;

/// Charts after merging, in the order of their first parts.
pub(super) fn merge(surface: &Surface, flats: Vec<Flat>) -> Vec<Flat> {
    if flats.len() < 2 {
        return flats;
    }
    let mut state = State::new(surface, flats);
    loop {
        let tries = state.tries();
        if tries.is_empty() {
            return state.charts.into_iter().flatten().collect();
        }
        let unions = parallel::map(tries.len(), |i| {
            let (a, b) = (state.charts[tries[i].0 as usize].as_ref()?, state.charts[tries[i].1 as usize].as_ref()?);
            let mut faces = [a.faces.as_slice(), b.faces.as_slice()].concat();
            faces.sort_unstable();
            flatten::project(surface, &faces)
        });
        let mut now: Vec<u32> = (0..state.charts.len() as u32).collect();
        for (key, union) in tries.into_iter().zip(unions) {
            match union {
                Some(flat) => {
                    state.unite(key.0, key.1, flat);
                    now[key.1 as usize] = key.0;
                }
                None => {
                    state.failed.insert(key);
                }
            }
        }
        state.rename(&now);
    }
}

/// A pair of charts and their versions.
type Try = (u32, u32, u32, u32);

/// An edge of a face, as seen by merging.
struct Edge {
    /// Chart of the face.
    chart: u32,
    /// Chart across the edge, or [`NONE`].
    other: u32,
    length: f64,
    soft: bool,
}

struct State {
    /// `None` where a chart was merged into another.
    charts: Vec<Option<Flat>>,
    /// Counts the changes of a chart, so that a pair that failed is not tried again while both stay the same.
    version: Vec<u32>,
    failed: HashSet<Try>,
    /// Sum of normal times area, and of area, of each chart.
    facing: Vec<(DVec3, f64)>,
    /// Edges between charts.
    edges: Vec<Edge>,
}

impl State {
    fn new(surface: &Surface, flats: Vec<Flat>) -> Self {
        let chart_of: HashMap<u32, u32> =
            flats.iter().enumerate().flat_map(|(c, flat)| flat.faces.iter().map(move |f| (*f, c as u32))).collect();
        let mut edges = Vec::new();
        for (chart, flat) in flats.iter().enumerate() {
            for f in &flat.faces {
                for k in 0..3 {
                    let g = surface.neighbor[*f as usize][k];
                    let other = chart_of.get(&g).copied().unwrap_or(NONE);
                    let (length, soft) = (surface.edge_length(*f, k), surface.soft[*f as usize][k]);
                    edges.push(Edge { chart: chart as u32, other, length, soft });
                }
            }
        }
        edges.retain(|edge| edge.chart != edge.other);
        let facing = flats
            .iter()
            .map(|flat| {
                flat.faces.iter().fold((DVec3::ZERO, 0.0), |(normal, area), f| {
                    let f = *f as usize;
                    (normal + surface.normal[f] * surface.area[f], area + surface.area[f])
                })
            })
            .collect();
        let version = vec![0; flats.len()];
        Self { charts: flats.into_iter().map(Some).collect(), version, failed: HashSet::new(), facing, edges }
    }

    /// Makes chart `a` the union, and `b` nothing.
    fn unite(&mut self, a: u32, b: u32, flat: Flat) {
        self.charts[a as usize] = Some(flat);
        self.charts[b as usize] = None;
        self.version[a as usize] += 1;
        let (normal, area) = self.facing[b as usize];
        self.facing[a as usize].0 += normal;
        self.facing[a as usize].1 += area;
    }

    /// Gives the edges the new numbers of their charts, and drops those that are inside now.
    fn rename(&mut self, now: &[u32]) {
        for edge in &mut self.edges {
            edge.chart = now[edge.chart as usize];
            if edge.other != NONE {
                edge.other = now[edge.other as usize];
            }
        }
        self.edges.retain(|edge| edge.chart != edge.other);
    }

    /// Pairs for one round: no chart twice, best first, none that failed before.
    fn tries(&self) -> Vec<Try> {
        let mut busy = vec![false; self.charts.len()];
        let mut tries = Vec::new();
        for (a, b) in self.pairs() {
            let key = (a, b, self.version[a as usize], self.version[b as usize]);
            if !busy[a as usize] && !busy[b as usize] && !self.failed.contains(&key) {
                busy[a as usize] = true;
                busy[b as usize] = true;
                tries.push(key);
            }
        }
        tries
    }

    /// Pairs of charts worth a try, best first.
    fn pairs(&self) -> Vec<(u32, u32)> {
        let mut outline = vec![0.0; self.charts.len()];
        let mut borders: Vec<(u32, u32, f64)> = Vec::new();
        for edge in &self.edges {
            outline[edge.chart as usize] += edge.length;
            if edge.soft && edge.other != NONE && edge.other > edge.chart {
                borders.push((edge.chart, edge.other, edge.length));
            }
        }
        borders.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
        let mut scored: Vec<(f64, u32, u32)> = borders
            .chunk_by(|x, y| (x.0, x.1) == (y.0, y.1))
            .map(|group| {
                let (a, b) = (group[0].0, group[0].1);
                let common: f64 = group.iter().map(|border| border.2).sum();
                (common / outline[a as usize].min(outline[b as usize]), a, b)
            })
            .filter(|(share, a, b)| {
                let (a, b) = (self.facing[*a as usize], self.facing[*b as usize]);
                *share >= LEAST_SHARE && (a.0 + b.0).length() >= flatten::MEAN_COS * (a.1 + b.1)
            })
            .collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        scored.into_iter().map(|(_, a, b)| (a, b)).collect()
    }
}
