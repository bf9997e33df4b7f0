//! `[[rules]]` of a configuration file: checks before anything is read.

use super::{Invalid, Options};
use crate::scene::Rule;

impl Options {
    /// The rules, each of which makes sense.
    pub(super) fn rules(&self) -> Result<Vec<Rule>, Invalid> {
        let rules = self.rules.clone().unwrap_or_default();
        for (k, rule) in rules.iter().enumerate() {
            rule.check().map_err(|why| {
                let text = serde_json::to_string(rule).unwrap_or_default();
                Invalid(format!("rule {} {text}: {why}", k + 1))
            })?;
        }
        Ok(rules)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_read_in_order_and_bad_ones_are_named() {
        let read = |text: &str| Options::from_toml(text).unwrap().settings();
        let two = "[[rules]]\nnodes = [\"a*\"]\ndensity = 2\n[[rules]]\nlights = [\"b\"]\nlight-group = \"c\"";
        let settings = read(two).unwrap();
        assert_eq!(settings.rules.len(), 2);
        let told = serde_json::to_value(&settings).unwrap();
        assert_eq!(
            told["rules"],
            serde_json::json!([
                {"nodes": ["a*"], "density": 2.0},
                {"lights": ["b"], "light-group": "c"},
            ])
        );
        assert!(!serde_json::to_string(&read("").unwrap()).unwrap().contains("rules"));
        let message = read(&two.replace("2", "-2")).unwrap_err().to_string();
        assert!(message.contains("rule 1") && message.contains("a*") && message.contains("density"), "{message}");
        for unknown in
            ["[[rules]]\nnode = [\"a\"]", "[[rules]]\nnodes = \"a\"", "[[rules]]\nnodes = [\"[\"]", "rules = 3"]
        {
            assert!(Options::from_toml(unknown).is_err(), "{unknown}");
        }
    }

    #[test]
    fn the_upper_layer_has_all_the_rules() {
        let [low, high] =
            ["a", "b"].map(|n| Options::from_toml(&format!("[[rules]]\nnodes = [\"{n}\"]\ncasts = false")));
        let both = high.unwrap().over(low.unwrap()).settings().unwrap();
        assert!(both.rules.len() == 1 && both.rules[0].nodes[0].matches("b"));
    }
}
