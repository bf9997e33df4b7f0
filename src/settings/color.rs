//! Colours as they are typed on the command line.

/// One number for grey, or three with commas.
pub(super) fn parse_color(text: &str) -> Result<[f32; 3], String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|v| v.trim().parse()).collect();
    match numbers.as_deref() {
        Ok([v]) => Ok([*v; 3]),
        Ok([r, g, b]) => Ok([*r, *g, *b]),
        _ => Err("give one number or three with commas, for example 0.3,0.5,1".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_one_or_three_numbers() {
        assert_eq!(parse_color("2"), Ok([2.0; 3]));
        assert_eq!(parse_color("1, 2,3"), Ok([1.0, 2.0, 3.0]));
        assert!(parse_color("1,2").is_err() && parse_color("red").is_err());
    }
}
