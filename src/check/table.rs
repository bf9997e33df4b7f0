//! The report as a table for people and as JSON.

use super::measure::{Kind, Measure};
use super::{Place, Report};
use std::fmt::Write;

impl Report {
    /// JSON with a final line break.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).map_or(String::new(), |s| s + "\n")
    }

    /// A table for people: a line per measure, and under each fault where it is worst.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut out = String::new();
        let _ = self.write_table(&mut out);
        out
    }

    fn write_table(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "{}", self.input)?;
        for (k, page) in self.pages.iter().enumerate() {
            let used = page.utilization * 100.0;
            writeln!(out, "page {k}: {} × {}, {} texels covered ({used:.0} %)", page.width, page.height, page.covered)?;
        }
        writeln!(out, "\n{:<14} {:>11} {:>11}  {:>9}         what the value is", "measure", "value", "limit", "count")?;
        for m in &self.measures {
            let state = if m.fault { "FAULT" } else { "ok" };
            let [value, limit] = [m.value, m.limit].map(|v| number(m.kind, v));
            writeln!(out, "{:<14} {value:>11} {limit:>11}  {:>9}  {state:<5}  {}", m.name, m.count, m.about)?;
        }
        for m in self.measures.iter().filter(|m| m.fault) {
            writeln!(out, "\n{}", m.name)?;
            for note in &m.notes {
                writeln!(out, "  {note}")?;
            }
            for place in &m.places {
                writeln!(out, "  {}", sentence(m, place))?;
            }
        }
        match self.faults.len() {
            0 => writeln!(out, "\nno faults"),
            _ => writeln!(out, "\nfaults: {}", self.faults.join(", ")),
        }
    }
}

/// Where a measure is bad, in a line.
fn sentence(measure: &Measure, place: &Place) -> String {
    let [x, y, z] = place.position;
    let [mesh, primitive] = place.mesh;
    let texel = match (place.page, place.texel) {
        (Some(page), Some([x, y])) => format!(", page {page} texel ({x}, {y})"),
        _ => String::new(),
    };
    let value = match measure.kind {
        Kind::MipBleeding | Kind::SeamStep | Kind::Leaks | Kind::DarkStrip => format!("{:.2} % ", place.value * 100.0),
        Kind::Firefly | Kind::Stretch | Kind::Density => format!("{:.1} times ", place.value),
        _ => String::new(),
    };
    format!("{value}at ({x:.3}, {y:.3}, {z:.3}) m on {} (mesh {mesh} primitive {primitive}){texel}", place.node)
}

/// A value of a measure as people write it.
fn number(kind: Kind, value: f64) -> String {
    match kind {
        Kind::UvRange | Kind::UvOverlap | Kind::UvDegenerate => percent(value),
        Kind::MipBleeding | Kind::SeamStep | Kind::Leaks | Kind::DarkStrip => percent(value),
        Kind::Density | Kind::Stretch => format!("{value:.3}"),
        _ => format!("{value}"),
    }
}

fn percent(value: f64) -> String {
    let percent = value * 100.0;
    if percent != 0.0 && percent < 0.01 { format!("{percent:.1e} %") } else { format!("{percent:.2} %") }
}
