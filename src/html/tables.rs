//! The report's figures as tables. Bars repeat what a number beside them says.

use super::document::{Change, Facts};
use super::groups::GroupPicture;
use super::markup::{count, escaped, measured, percent, picture, seconds, significant, size};
use super::scale::Share;
use crate::base::Rgb;
use crate::base::Warning;
use crate::base::color::{linear_to_srgb, luminance};
use crate::output::report::{Pass, Report, Vertices, Walk};
use core::fmt::Write;

/// A table with a row of names above it; cells are HTML.
fn table(class: &str, head: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let heads: String = head.iter().map(|h| format!("<th scope=\"col\">{h}</th>")).collect();
    let row = |cells: Vec<String>| {
        let cells: String = cells.iter().map(|c| format!("<td>{c}</td>")).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let rows: String = rows.map(row).collect();
    format!(
        "<div class=\"scroll\"><table class=\"{class}\">\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n"
    )
}

/// A section with a heading.
pub(super) fn section(id: &str, heading: &str, html: &str) -> String {
    format!("<section id=\"{id}\">\n<h2>{heading}</h2>\n{html}</section>\n")
}

fn bar(part: f64) -> String {
    format!("<span class=\"bar\"><i style=\"width:{:.1}%\"></i></span>", (part * 100.0).clamp(0.0, 100.0))
}

/// Seconds by stage; stages that ran more than once as one row.
pub(super) fn stages(report: &Report) -> String {
    let mut sums: Vec<(&str, f64, u32)> = vec![];
    for stage in &report.stages {
        match sums.iter_mut().find(|(name, ..)| *name == stage.name) {
            Some(sum) => (sum.1, sum.2) = (sum.1 + stage.seconds, sum.2 + 1),
            None => sums.push((&stage.name, stage.seconds, 1)),
        }
    }
    let all = total(report).max(1e-9);
    let row = |&(name, spent, times): &(&str, f64, u32)| {
        let times = if times > 1 { format!(" × {times}") } else { String::new() };
        vec![format!("{}{times}", escaped(name)), bar(spent / all), seconds(spent), percent_of_time(spent / all)]
    };
    measured(&table("stages", &["Stage", "", "Time", "Share"], sums.iter().map(row)))
}

fn percent_of_time(part: f64) -> String {
    format!("{:.0} %", part * 100.0)
}

/// Seconds of all stages.
pub(super) fn total(report: &Report) -> f64 {
    report.stages.iter().fold(0.0, |sum, stage| sum + stage.seconds)
}

/// The passes of the solver, and what ended them.
pub(super) fn passes(report: &Report) -> String {
    let refinement = &report.refinement;
    let row = |(k, pass): (usize, &Pass)| {
        vec![
            (k + 1).to_string(),
            format!("{} ×", significant(pass.budget, 3)),
            percent(pass.estimated_nrmse),
            measured(&seconds(pass.seconds)),
        ]
    };
    let goal = |goal: Option<String>| goal.map_or(String::new(), |g| format!(" The goal was {g}."));
    let error = goal(refinement.target_error.map(|e| format!("a stated error of {}", percent(e))));
    let time = goal(refinement.time_limit.map(|s| format!("{} s", significant(s, 4))));
    let ended = escaped(&refinement.ended_by);
    let head = ["Pass", "Rays, of the settings’", "Stated error so far", "Time"];
    let rows = refinement.passes.iter().enumerate().map(row);
    format!("{}<p class=\"note\">Ended by: {ended}.{error}{time}</p>\n", table("passes", &head, rows))
}

/// Where the power of the walk went.
pub(super) fn ledger(walk: &Walk) -> String {
    let shown = |power: [f64; 3]| f64::from(luminance(Rgb::from_array(power.map(|p| p as f32))));
    let all = shown(walk.power_in);
    let row = |(name, power): (&str, [f64; 3])| {
        let part = if all > 0.0 { shown(power) / all } else { 0.0 };
        let [r, g, b] = power.map(|p| significant(p, 4));
        vec![name.to_owned(), bar(part), percent(part), significant(shown(power), 4), r, g, b]
    };
    let rows = [
        ("From lights onto surfaces", walk.power_in),
        ("Absorbed", walk.power_absorbed),
        ("Left the scene", walk.power_escaped),
        ("Not followed further", walk.power_residual),
    ];
    let head = ["Power", "", "Share", "Luminous, lm", "R, lm", "G, lm", "B, lm"];
    let lines = format!("{} lines, {} bounces.", count(walk.lines), walk.bounces);
    format!("{}<p class=\"note\">{lines}</p>\n", table("ledger", &head, rows.into_iter().map(row)))
}

/// How good the fit at vertices is.
pub(super) fn vertices(fit: &Vertices) -> String {
    let rows = [
        ("Fitted by least squares (what was written)", fit.fit_nrmse),
        ("Texels at the vertices", fit.sampled_nrmse),
        ("Means around the vertices", fit.averaged_nrmse),
    ];
    let worst = rows.iter().fold(1e-9, |worst: f64, (_, error)| worst.max(*error));
    let row = |(name, error): (&str, f64)| vec![name.to_owned(), bar(error / worst), percent(error)];
    let counts = [fit.vertices, fit.unknowns, fit.triangles].map(count);
    let [all, unknowns, triangles] = counts;
    format!(
        "<p>{all} vertices with {unknowns} different values on {triangles} triangles.</p>\n{}",
        table("fit", &["Method", "", "Error against the texels"], rows.into_iter().map(row))
    )
}

/// Warnings in the order in which they came up.
pub(super) fn warnings(warnings: &[Warning]) -> String {
    let row = |w: &Warning| {
        let node = w.node.as_deref().map_or("–".to_owned(), escaped);
        vec![format!("<code>{}</code>", escaped(w.code)), node, escaped(&w.message)]
    };
    table("warnings", &["Code", "Node", "Message"], warnings.iter().map(row))
}

/// Settings that are not the preset's.
pub(super) fn changes(facts: &Facts<'_>) -> String {
    let preset = escaped(facts.preset);
    if facts.changes.is_empty() {
        return format!("<p>All as in the preset <code>{preset}</code>.</p>\n");
    }
    let row = |c: &Change| [&c.option, &c.value, &c.preset].map(|t| format!("<code>{}</code>", escaped(t))).to_vec();
    let head = format!("Preset <code>{preset}</code>");
    table("settings", &["Option", "This bake", &head], facts.changes.iter().map(row))
}

/// Files that were written beside this one.
pub(super) fn files(facts: &Facts<'_>) -> String {
    let row = |(name, bytes): &(String, u64)| vec![format!("<code>{}</code>", escaped(name)), size(*bytes)];
    table("files", &["File", "Size"], facts.files.iter().map(row))
}

/// The colours of a heat map and what they stand for.
pub(super) fn legend(what: &str, shares: &[Share]) -> String {
    let mut items = String::new();
    for Share { label, color, share } in shares {
        let [r, g, b] = color.map(|c| (linear_to_srgb(c.clamp(0.0, 1.0)) * 255.0).round() as u8);
        // Writing to a string cannot fail.
        let _ = writeln!(
            items,
            "<li><i style=\"background:#{r:02x}{g:02x}{b:02x}\"></i><span>{label}</span><b>{}</b></li>",
            percent(*share)
        );
    }
    format!("<p class=\"note\">{what}</p>\n<ol class=\"legend\">\n{items}</ol>\n")
}

/// Groups of lights: pictures, then their shares.
pub(super) fn groups(groups: &[GroupPicture]) -> String {
    let figure = |group: &GroupPicture| {
        let name = escaped(&group.name);
        let picture = group.picture.as_ref().map_or(String::new(), |image| {
            picture(image, "", &format!("The scene lit by the group {} alone", group.name))
        });
        let share = percent(group.share);
        format!("<figure>{picture}<figcaption><b>{name}</b> {share} of the light</figcaption></figure>\n")
    };
    let figures: String = groups.iter().map(figure).collect();
    format!(
        "<p>The first view by each group alone, with the exposure of all together. What glows is drawn in every one.</p>\n\
         <div class=\"grid\">\n{figures}</div>\n"
    )
}
