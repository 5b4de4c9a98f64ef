//! Settings of a survey: a TOML file whose section `[classifier]` says what is to differ from a survey's defaults.
//!
//! These are not the defaults on a vehicle: a survey looks at a whole plot at once, with time to spare.

use super::parse::{SectionReader, Sections, Validate};
use serde::Serialize;
use tsense_contract::Fault;

/// The stages that a survey can be told about.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SurveyConfig {
    /// What is ground, brush, trunk.
    pub classifier: tsense_classifier::Config,
}

impl Default for SurveyConfig {
    fn default() -> Self {
        Self { classifier: tsense_classifier::Config::for_survey() }
    }
}

impl Sections for SurveyConfig {
    const NAMES: &'static [&'static str] = &["classifier"];

    fn read(&mut self, name: &str, reader: &mut SectionReader<'_, '_>) {
        match name {
            "classifier" => reader.changes(&mut self.classifier),
            _ => reader.unknown(Self::NAMES),
        }
    }
}

impl Validate for SurveyConfig {
    fn faults(&self) -> Vec<(String, Fault)> {
        self.classifier.validate().into_iter().map(|fault| ("classifier".to_owned(), fault)).collect()
    }
}

impl SurveyConfig {
    /// The settings as TOML, every key written out.
    pub fn to_toml(&self) -> String {
        super::to_toml(self)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{parse::parse, report::render};
    use super::*;

    fn read(text: &str) -> Result<SurveyConfig, String> {
        parse(text).map_err(|reports| render("s.toml", text, &reports))
    }

    #[test]
    fn what_is_not_said_keeps_a_surveys_default() {
        let changed =
            read("[classifier]\ndetector = \"thesis\"\n[classifier.ground.surface]\ncover_std_m = 0.5\n").unwrap();
        let mut expected = SurveyConfig::default();
        expected.classifier.detector = tsense_classifier::config::Detector::Thesis;
        expected.classifier.ground.surface.cover_std_m = 0.5;
        assert_eq!(changed, expected);
        assert_ne!(expected.classifier.brush, tsense_classifier::Config::default().brush);
    }

    #[test]
    fn the_defaults_survive_being_written_out() {
        let config = SurveyConfig::default();
        assert_eq!(config.classifier.validate(), vec![]);
        assert_eq!(read(&config.to_toml()), Ok(config));
    }

    #[test]
    fn faults_are_told_with_their_lines() {
        let shown = read("[mapper]\n[classifier.trunk]\nthresold = 2.0\n").unwrap_err();
        for part in
            ["s.toml:1:2: [mapper]: unknown section", "s.toml:3:1: [classifier] thresold: unknown key; did you mean"]
        {
            assert!(shown.contains(part), "{part}\nis not in\n{shown}");
        }
        let shown = read("[classifier.ground]\ntile_m = 99.0\n").unwrap_err();
        assert!(shown.contains("s.toml:2:10: [classifier] ground.tile_m = 99: allowed is from 0.5 to 10 m"), "{shown}");
    }
}
