//! Colours as they are typed on the command line, and as files have them.

use serde::{Deserialize, Deserializer};

/// One number for grey, or three with commas.
pub(super) fn parse_color(text: &str) -> Result<[f32; 3], String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|v| v.trim().parse()).collect();
    match numbers.as_deref() {
        Ok([v]) => Ok([*v; 3]),
        Ok([r, g, b]) => Ok([*r, *g, *b]),
        _ => Err("give one number or three with commas, for example 0.3,0.5,1".into()),
    }
}

/// One number for grey, or an array of three.
#[derive(Deserialize)]
#[serde(untagged, expecting = "give one number or three, for example 0.5 or [0.3, 0.5, 1]")]
enum Color {
    Grey(f32),
    Rgb([f32; 3]),
}

pub(super) fn read<'de, D: Deserializer<'de>>(value: D) -> Result<Option<[f32; 3]>, D::Error> {
    Ok(match Option::<Color>::deserialize(value)? {
        None => None,
        Some(Color::Grey(v)) => Some([v; 3]),
        Some(Color::Rgb(color)) => Some(color),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Options;

    #[test]
    fn files_have_one_number_or_three() {
        let sky = |text: &str| Options::from_toml(&format!("sky = {text}")).map(|options| options.sky);
        assert_eq!(sky("0.5").unwrap(), Some([0.5; 3]));
        assert_eq!(sky("2").unwrap(), Some([2.0; 3]));
        assert_eq!(sky("[1, 2.5, 0]").unwrap(), Some([1.0, 2.5, 0.0]));
        for wrong in ["[1, 2]", "\"red\"", "true"] {
            let error = sky(wrong).unwrap_err().to_string();
            assert!(error.contains("sky") && error.contains("one number or three"), "{error}");
        }
    }

    #[test]
    fn colors_are_one_or_three_numbers() {
        assert_eq!(parse_color("2"), Ok([2.0; 3]));
        assert_eq!(parse_color("1, 2,3"), Ok([1.0, 2.0, 3.0]));
        assert!(parse_color("1,2").is_err() && parse_color("red").is_err());
    }
}
