//! IES files (LM-63): what a goniometer measured of a lamp → [`Profile`].
//!
//! In: bytes. Out: candela by direction, and whether the file tilts its lamps. Versions LM-63-1986 (no first line), 1991,
//! 1995, 2002 and 2019; photometric types C, B and A.
//!
//! Source: the reading order of LM-63-2002 as I. Ashdown, *Parsing the IESNA LM-63 Photometric Data File* (1998), has it; the
//! frame and the differences between versions are those of the glTF extension `EXT_lights_ies`. Axes of the types: CIE 121.
//!
//! * The zero angles aim along −z. Type C: vertical angle from −z, horizontal angle from +x toward +y. Type B: vertical angle
//!   about y, from −z toward +x, horizontal angle out of that plane, toward −y. Type A: horizontal angle about x, from
//!   −z toward −y, vertical angle out of that plane, toward +x.
//! * Type C that ends at 0° is even all around, at 90° and 180° mirrored, from 90° to 270° mirrored across the plane of
//!   90° and 270°; what ends between 180° and 360° is closed by its first plane. Types A and B that start at 0° are mirrored.
//! * Candela are multiplied by multiplier and ballast factor; before 1995 by the ballast-lamp factor, too, whose place
//!   holds something else since. Lumens, lamps, sizes and watts say nothing about the light and are skipped.
//!
//! Limits: tilt factors of the lamps (`TILT=INCLUDE`, `TILT=file`) are not applied. A lamp is a point, or a sphere.
//!
//! Bounds: [`MAX_BYTES`], [`MAX_ANGLES`], [`MAX_VALUES`]; nothing is allocated by what the file claims.

use super::{Error, Profile};
use core::iter::Peekable;
use glam::{Mat3, Vec3};

/// Largest file; a value every quarter of a degree takes 9 MB.
pub(super) const MAX_BYTES: usize = 1 << 24;
/// Most angles of a kind.
const MAX_ANGLES: usize = 1 << 13;
/// Most candela values.
const MAX_VALUES: usize = 1 << 20;

/// What a file says.
#[derive(Debug)]
pub struct Read {
    /// The light.
    pub profile: Profile,
    /// Lamps have factors by their tilt, which were not applied.
    pub tilts: bool,
}

/// Reads a file.
///
/// # Errors
/// It is not LM-63, is incomplete, or holds numbers that make no sense; the message names the line.
pub fn read(bytes: &[u8]) -> Result<Read, Error> {
    if bytes.len() > MAX_BYTES {
        return Err(Error::unsupported(format!("it has more than {} MiB; no IES file does", MAX_BYTES >> 20)));
    }
    let text = String::from_utf8_lossy(bytes);
    let separator = if text.contains('\n') { '\n' } else { '\r' };
    let mut lines = text.split(separator).enumerate();
    let old = is_before_1995(text.lines().next().unwrap_or_default());
    let Some((tilt_line, tilt)) = lines.by_ref().find_map(|(n, line)| Some((n + 1, tilt_of(line)?))) else {
        return Err(Error::invalid("it has no line `TILT=`; is it an IES file (LM-63)?"));
    };
    let words = lines.flat_map(|(n, line)| {
        line.split(|c: char| c.is_whitespace() || c == ',' || c == '\x1a')
            .filter(|w| !w.is_empty())
            .map(move |w| (n + 1, w))
    });
    let mut numbers = Numbers { words: words.peekable(), line: tilt_line };
    if tilt.eq_ignore_ascii_case("INCLUDE") {
        numbers.next("the lamp-to-luminaire geometry")?;
        let pairs = numbers.count("the number of tilt angles", MAX_ANGLES)?;
        numbers.many(2 * pairs, "tilt angles and factors")?;
    }
    let profile = profile(&mut numbers, old)?;
    Ok(Read { profile, tilts: !tilt.eq_ignore_ascii_case("NONE") })
}

/// What stands behind `TILT=`.
fn tilt_of(line: &str) -> Option<&str> {
    let line = line.trim();
    line.get(..5).filter(|key| key.eq_ignore_ascii_case("TILT=")).map(|_| line[5..].trim())
}

/// By the first line: files of 1986 have none of their own, those of 1991 say `IESNA91`.
fn is_before_1995(first: &str) -> bool {
    let year = first.trim().rsplit('-').next().and_then(|y| y.parse::<u32>().ok());
    !(first.trim_start().starts_with("IES") && year.is_some_and(|y| y >= 1995))
}

/// The numbers of a file, in order.
struct Numbers<'a, I: Iterator<Item = (usize, &'a str)>> {
    words: Peekable<I>,
    /// Of the last word.
    line: usize,
}

impl<'a, I: Iterator<Item = (usize, &'a str)>> Numbers<'a, I> {
    fn wrong(&self, what: &str) -> Error {
        Error::invalid(format!("line {}: {what}", self.line))
    }

    fn next(&mut self, what: &str) -> Result<f64, Error> {
        let Some((line, word)) = self.words.next() else {
            return Err(self.wrong(&format!("the file ends where {what} should be")));
        };
        self.line = line;
        let number = word.parse::<f64>().ok().filter(|n| n.is_finite());
        number.ok_or_else(|| {
            let shown: String = word.chars().take(20).collect();
            self.wrong(&format!("{what}: {shown:?} is not a number"))
        })
    }

    fn count(&mut self, what: &str, most: usize) -> Result<usize, Error> {
        let number = self.next(what)?;
        if number.fract() == 0.0 && (1.0..=most as f64).contains(&number) {
            Ok(number as usize)
        } else {
            Err(self.wrong(&format!("{what} is {number}; it must be a whole number from 1 to {most}")))
        }
    }

    fn factor(&mut self, what: &str) -> Result<f64, Error> {
        let number = self.next(what)?;
        if number > 0.0 { Ok(number) } else { Err(self.wrong(&format!("{what} is {number}, not positive"))) }
    }

    fn many(&mut self, count: usize, what: &str) -> Result<Vec<f64>, Error> {
        let mut all = vec![];
        for _ in 0..count {
            all.push(self.next(what)?);
        }
        Ok(all)
    }

    fn angles(&mut self, count: usize, what: &str, [low, high]: [f64; 2]) -> Result<Vec<f64>, Error> {
        let mut all: Vec<f64> = vec![];
        for _ in 0..count {
            let angle = self.next(what)?;
            if !(low..=high).contains(&angle) || all.last().is_some_and(|last| *last >= angle) {
                return Err(
                    self.wrong(&format!("{what} must ascend from {low} to {high} at most, but there is {angle}"))
                );
            }
            all.push(angle);
        }
        Ok(all)
    }
}

fn profile<'a>(numbers: &mut Numbers<'a, impl Iterator<Item = (usize, &'a str)>>, old: bool) -> Result<Profile, Error> {
    numbers.next("the number of lamps")?;
    numbers.next("the lumens per lamp")?;
    let multiplier = numbers.factor("the candela multiplier")?;
    let vertical = numbers.count("the number of vertical angles", MAX_ANGLES)?;
    let horizontal = numbers.count("the number of horizontal angles", MAX_ANGLES)?;
    if vertical * horizontal > MAX_VALUES {
        return Err(numbers.wrong(&format!("{vertical} × {horizontal} angles; {MAX_VALUES} values are the limit")));
    }
    let kind = numbers.count("the photometric type", 3)?;
    for what in ["the unit", "the width", "the length", "the height"] {
        numbers.next(what)?;
    }
    let ballast = numbers.factor("the ballast factor")?;
    let further = numbers.next("what follows the ballast factor")?;
    if old && further <= 0.0 {
        return Err(numbers.wrong(&format!("the ballast-lamp factor is {further}, not positive")));
    }
    let factor = multiplier * ballast * if old { further } else { 1.0 };
    numbers.next("the watts")?;
    let (down, around) = if kind == 1 { ([0.0, 180.0], [0.0, 360.0]) } else { ([-90.0, 90.0], [-90.0, 90.0]) };
    let vertical = numbers.angles(vertical, "vertical angles", down)?;
    let horizontal = numbers.angles(horizontal, "horizontal angles", around)?;
    let mut candela = Vec::new();
    for _ in 0..vertical.len() * horizontal.len() {
        let value = numbers.next("candela values")?;
        if value < 0.0 {
            return Err(numbers.wrong(&format!("a candela value is {value}, negative")));
        }
        candela.push((value * factor) as f32);
    }
    let table = Table { horizontal, vertical, candela };
    let profile = match kind {
        1 => table.around_the_axis(),
        2 => table.mirrored().laid_out(false),
        _ => table.mirrored().laid_out(true),
    };
    profile.ok_or_else(|| {
        let what = "these angles or candela values give no distribution; type C ends at 0, 90, 180 or 360°, or has 90° to 270°";
        numbers.wrong(what)
    })
}

/// A table as in the file [degree, cd]: a column of vertical angles for each horizontal one.
struct Table {
    horizontal: Vec<f64>,
    vertical: Vec<f64>,
    candela: Vec<f32>,
}

impl Table {
    fn column(&self, h: usize) -> &[f32] {
        &self.candela[h * self.vertical.len()..(h + 1) * self.vertical.len()]
    }

    /// Adds the columns that mirror those there are across the last plane.
    fn continue_mirrored(&mut self) {
        let last = self.horizontal.len() - 1;
        let edge = self.horizontal[last];
        for h in (0..last).rev() {
            self.horizontal.push(2.0 * edge - self.horizontal[h]);
            let column = self.column(h).to_vec();
            self.candela.extend(column);
        }
    }

    /// Type C.
    fn around_the_axis(mut self) -> Option<Profile> {
        let near = |a: f64, b: f64| (a - b).abs() < 1e-3;
        let (first, last) = (self.horizontal[0], self.horizontal[self.horizontal.len() - 1]);
        if self.horizontal.len() == 1 {
            self.horizontal = vec![0.0, 360.0];
            self.candela.extend(self.candela.clone());
        } else if near(first, 0.0) && near(last, 90.0) {
            self.continue_mirrored();
            self.continue_mirrored();
        } else if near(first, 0.0) && near(last, 180.0) || near(first, 90.0) && near(last, 270.0) {
            self.continue_mirrored();
        } else if near(first, 0.0) && last > 180.0 && !near(last, 360.0) {
            self.horizontal.push(360.0);
            let column = self.column(0).to_vec();
            self.candela.extend(column);
        } else if !(near(first, 0.0) && near(last, 360.0)) {
            return None;
        }
        let rows = (0..self.vertical.len()).flat_map(|v| (0..self.horizontal.len()).map(move |h| (h, v)));
        let candela = rows.map(|(h, v)| self.column(h)[v]).collect();
        let latitudes = self.vertical.iter().map(|v| (v - 90.0).to_radians() as f32).collect();
        Profile::new(radians(&self.horizontal), latitudes, candela, Mat3::IDENTITY)
    }

    /// Types A and B: angles from −90°, where they start at 0.
    fn mirrored(mut self) -> Self {
        let rows = self.vertical.len();
        if self.vertical[0] == 0.0 {
            let full = |column: &[f32]| column[1..].iter().rev().chain(column).copied().collect::<Vec<f32>>();
            self.candela = self.candela.chunks(rows).flat_map(full).collect();
            self.vertical = both_sides(&self.vertical);
        }
        let rows = self.vertical.len();
        if self.horizontal[0] == 0.0 {
            let others: Vec<f32> = self.candela[rows..].chunks(rows).rev().flatten().copied().collect();
            self.candela = [others, self.candela].concat();
            self.horizontal = both_sides(&self.horizontal);
        }
        self
    }

    /// Types A and B: which of the angles turns about the pole, the horizontal one?
    fn laid_out(self, horizontal_turns: bool) -> Option<Profile> {
        if horizontal_turns {
            let rows = (0..self.vertical.len()).flat_map(|v| (0..self.horizontal.len()).map(move |h| (h, v)));
            let candela = rows.map(|(h, v)| self.column(h)[v]).collect();
            let axes = Mat3::from_cols(-Vec3::Z, -Vec3::Y, Vec3::X);
            Profile::new(radians(&self.horizontal), radians(&self.vertical), candela, axes)
        } else {
            let axes = Mat3::from_cols(-Vec3::Z, Vec3::X, -Vec3::Y);
            Profile::new(radians(&self.vertical), radians(&self.horizontal), self.candela, axes)
        }
    }
}

fn both_sides(angles: &[f64]) -> Vec<f64> {
    angles[1..].iter().rev().map(|a| -a).chain(angles.iter().copied()).collect()
}

fn radians(degrees: &[f64]) -> Vec<f32> {
    degrees.iter().map(|d| d.to_radians() as f32).collect()
}
