//! From text to a configuration, with every fault found in one go.
//!
//! Sections are read one by one by their own types. When a section refuses a key, the key is noted, taken out, and the
//! section is read again, so that a second slip is found as well; what was taken out never takes effect, because a
//! text with any fault gives no configuration at all.

use super::nearest::nearest;
use super::report::Report;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::ops::Range;
use toml::de::{DeTable, DeValue, ValueDeserializer};
use toml::{Spanned, Value};
use tsense_contract::Fault;

/// Faults noted in one section before reading gives up on it: a whole wrong file needs no more.
const FAULTS_MAX: usize = 32;

/// A configuration made of sections.
pub trait Sections: Default {
    /// The known sections.
    const NAMES: &'static [&'static str];
    /// Reads one section.
    fn read(&mut self, name: &str, reader: &mut SectionReader<'_, '_>);
}

/// Reads a whole configuration; all faults of the text, or else of the values.
pub fn parse<C: Sections + Validate>(text: &str) -> Result<C, Vec<Report>> {
    let table = match DeTable::parse(text) {
        Ok(table) => table,
        Err(e) => return Err(vec![Report { span: e.span(), message: e.message().to_owned() }]),
    };
    let (mut config, mut reports) = (C::default(), Vec::new());
    for (key, value) in table.get_ref().iter() {
        let name = key.get_ref().as_ref();
        let mut reader = SectionReader { name, key: key.span(), value, reports: &mut reports };
        config.read(name, &mut reader);
    }
    if reports.is_empty() {
        let faults = config.faults();
        reports = faults.iter().map(|(section, fault)| value_report(table.get_ref(), section, fault)).collect();
    }
    if reports.is_empty() { Ok(config) } else { Err(reports) }
}

/// Checks values once the text is read.
pub trait Validate {
    /// All faults as section (`ladar.0` for the first of a list) and fault.
    fn faults(&self) -> Vec<(String, Fault)>;
}

impl Validate for super::Config {
    fn faults(&self) -> Vec<(String, Fault)> {
        self.validate()
    }
}

fn value_report(table: &DeTable<'_>, section: &str, fault: &Fault) -> Report {
    let path = section.split('.').chain(fault.key.split('.'));
    Report { span: locate(table, path), message: format!("[{section}] {fault}") }
}

/// Where the value of a key stands; as deep as the text goes.
fn locate<'p>(table: &DeTable<'_>, path: impl Iterator<Item = &'p str>) -> Option<Range<usize>> {
    let (mut found, mut here) = (None, None);
    for part in path {
        let next = match here {
            None => table.get(part),
            Some(value) => step(value, part),
        };
        let Some(next) = next else { break };
        found = Some(next.span());
        here = Some(next.get_ref());
    }
    // A section's header alone is no place of a key that is not written there.
    found.filter(|_| {
        here.is_some_and(|value| !matches!(value, DeValue::Table(_) | DeValue::Array(_)) || value.is_array())
    })
}

fn step<'v, 'i>(value: &'v DeValue<'i>, part: &str) -> Option<&'v Spanned<DeValue<'i>>> {
    match value {
        DeValue::Table(table) => table.get(part),
        DeValue::Array(array) => array.get(part.parse::<usize>().ok()?),
        _ => None,
    }
}

/// One section of the text on its way to its type.
pub struct SectionReader<'t, 'i> {
    name: &'t str,
    key: Range<usize>,
    value: &'t Spanned<DeValue<'i>>,
    reports: &'t mut Vec<Report>,
}

impl SectionReader<'_, '_> {
    /// A section of its own; none where it says `enabled = false`.
    pub fn section<T: DeserializeOwned>(&mut self) -> Option<T> {
        self.is_section().then(|| self.table(self.name.to_owned(), self.value.clone()))?
    }

    /// A section of several processes, with a field of its own for the switch of each: `enabled` stays in it.
    pub fn section_of_several<T: DeserializeOwned>(&mut self) -> Option<T> {
        self.is_section().then(|| self.typed(self.name, self.value.clone()))?
    }

    /// A section that says what is to differ from `base`.
    pub fn changes<T: Serialize + DeserializeOwned>(&mut self, base: &mut T) {
        if !self.is_section() || self.typed::<T>(self.name, self.value.clone()).is_none() {
            return;
        }
        let changed = Value::try_from(&*base).map_err(|e| e.to_string()).and_then(|mut changed| {
            let changes = Value::deserialize(ValueDeserializer::from(self.value.clone())).map_err(|e| e.to_string())?;
            overlay(&mut changed, changes);
            changed.try_into().map_err(|e| e.to_string())
        });
        match changed {
            Ok(changed) => *base = changed,
            Err(message) => self.fault(self.key.clone(), format!("[{}] {message}", self.name)),
        }
    }

    fn is_section(&mut self) -> bool {
        let is = matches!(self.value.get_ref(), DeValue::Table(_));
        if !is {
            self.fault(self.key.clone(), format!("`{0}` is a section: write [{0}] on a line of its own", self.name));
        }
        is
    }

    /// A list of sections.
    pub fn list<T: DeserializeOwned>(&mut self) -> Vec<T> {
        let DeValue::Array(array) = self.value.get_ref() else {
            self.fault(self.key.clone(), format!("`{0}` is a list: write [[{0}]], one for each", self.name));
            return Vec::new();
        };
        let entries = array.iter().enumerate().map(|(i, entry)| (format!("{}.{i}", self.name), entry.clone()));
        let entries: Vec<_> = entries.collect();
        entries.into_iter().filter_map(|(name, entry)| self.table(name, entry)).collect()
    }

    /// A section that nobody knows.
    pub fn unknown(&mut self, known: &[&str]) {
        let advice = match nearest(self.name, known.iter().copied()) {
            Some(near) => format!("did you mean [{near}]?"),
            None => format!("known are {}", known.join(", ")),
        };
        self.fault(self.key.clone(), format!("[{}]: unknown section; {advice}", self.name));
    }

    fn table<T: DeserializeOwned>(&mut self, name: String, mut value: Spanned<DeValue<'_>>) -> Option<T> {
        let enabled = self.take_enabled(&name, &mut value);
        self.typed(&name, value).filter(|_| enabled)
    }

    fn typed<T: DeserializeOwned>(&mut self, name: &str, mut value: Spanned<DeValue<'_>>) -> Option<T> {
        for _ in 0..FAULTS_MAX {
            match T::deserialize(ValueDeserializer::from(value.clone())) {
                Ok(section) => return Some(section),
                Err(e) => {
                    let span = e.span().unwrap_or_else(|| value.span());
                    self.fault(span.clone(), format!("[{name}] {}", explain(e.message())));
                    if !remove(value.get_mut(), &span) {
                        return None;
                    }
                }
            }
        }
        None
    }

    /// The key `enabled` belongs to the launcher and not to the stage.
    fn take_enabled(&mut self, name: &str, value: &mut Spanned<DeValue<'_>>) -> bool {
        let DeValue::Table(table) = value.get_mut() else { return true };
        let Some(enabled) = table.remove("enabled") else { return true };
        let Some(is) = enabled.get_ref().as_bool() else {
            self.fault(enabled.span(), format!("[{name}] enabled: allowed is true or false"));
            return true;
        };
        is
    }

    fn fault(&mut self, span: Range<usize>, message: String) {
        self.reports.push(Report { span: Some(span), message });
    }
}

/// Puts values in the place of those with the same keys.
fn overlay(base: &mut Value, changes: Value) {
    match (base, changes) {
        (Value::Table(base), Value::Table(changes)) => {
            for (key, change) in changes {
                match base.get_mut(&key) {
                    Some(value) => overlay(value, change),
                    None => drop(base.insert(key, change)),
                }
            }
        }
        (base, change) => *base = change,
    }
}

/// An unknown key gets the nearest known one; other messages stay as they are.
fn explain(message: &str) -> String {
    let Some(rest) = message.strip_prefix("unknown field `") else { return message.to_owned() };
    let mut quoted = rest.split('`').step_by(2);
    let Some(key) = quoted.next() else { return message.to_owned() };
    let known: Vec<&str> = rest.split('`').skip(2).step_by(2).collect();
    match nearest(key, known.iter().copied()) {
        Some(near) => format!("{key}: unknown key; did you mean `{near}`?"),
        None => format!("{key}: unknown key; known are {}", known.join(", ")),
    }
}

/// Takes out the key at, or the value around, a place in the text; false where nothing is there.
fn remove(value: &mut DeValue<'_>, span: &Range<usize>) -> bool {
    match value {
        DeValue::Table(table) => {
            let hit = |place: Range<usize>| place.start <= span.start && span.end <= place.end;
            let deeper = table.iter_mut().any(|(_, v)| hit(v.span()) && remove(v.get_mut(), span));
            if deeper {
                return true;
            }
            let key = table.iter().find(|(k, v)| hit(k.span()) || hit(v.span())).map(|(k, _)| k.get_ref().to_string());
            key.is_some_and(|key| table.remove(key.as_str()).is_some())
        }
        DeValue::Array(array) => {
            let hit = |place: Range<usize>| place.start <= span.start && span.end <= place.end;
            array.iter_mut().any(|v| hit(v.span()) && remove(v.get_mut(), span))
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::super::report::render;
    use super::super::{Config, parse::parse};

    fn faults(text: &str) -> String {
        render("t.toml", text, &parse::<Config>(text).expect_err("faulty"))
    }

    #[test]
    fn all_unknown_keys_of_all_sections_are_found_at_once_with_the_nearest_known_one() {
        let shown = faults(
            "[graph]\nnmae = \"x\"\n[kstore]\ngate_mm = 0.3\npublish_radius = 5.0\n[brigde]\n[kstore.time_constant]\ntrees_s = 1.0\n",
        );
        for part in [
            "t.toml: 5 faults",
            "t.toml:2:1: [graph] nmae: unknown key; did you mean `name`?\n    2 | nmae = \"x\"\n      | ^^^^\n",
            "t.toml:4:1: [kstore] gate_mm: unknown key; did you mean `gate_m`?",
            "t.toml:5:1: [kstore] publish_radius: unknown key; did you mean `publish_radius_m`?",
            "t.toml:6:2: [brigde]: unknown section; did you mean [bridge]?",
            "t.toml:8:1: [kstore] trees_s: unknown key; did you mean `tree_s`?",
        ] {
            assert!(shown.contains(part), "{part}\nis not in\n{shown}");
        }
    }

    #[test]
    fn wrong_types_are_found_beside_unknown_keys() {
        let shown = faults("[kstore]\ngate_m = \"wide\"\nfoo = 1\nobjects_max = -3\n");
        for part in
            ["t.toml: 3 faults", "t.toml:2:10: [kstore] invalid type: string \"wide\"", "t.toml:3:1", "t.toml:4:15"]
        {
            assert!(shown.contains(part), "{part}\nis not in\n{shown}");
        }
    }

    #[test]
    fn all_faulty_values_are_listed_with_line_value_and_allowed_range() {
        let shown = faults(
            "[graph]\nname = \"A_b\"\n[kstore]\ngate_m = 99.0\n[kstore.time_constant]\nbrush_s = 0.0\n[[ladar]]\n[[ladar]]\nfrequency_hz = 12.0\n",
        );
        for part in [
            "t.toml:2:8: [graph] name = A_b: allowed is 1 to 16 characters out of a-z, 0-9 and -",
            "t.toml:4:10: [kstore] gate_m = 99: allowed is from 0.01 to 10 m",
            "t.toml:6:11: [kstore] time_constant.brush_s = 0: allowed is from 1 to 3200000000 s",
            "t.toml:9:16: [ladar.1] frequency_hz = 12: allowed is 25 or 50 Hz",
            "t.toml: [ladar.1] name = ladar: allowed is a name of its own",
        ] {
            assert!(shown.contains(part), "{part}\nis not in\n{shown}");
        }
    }

    #[test]
    fn a_grid_that_no_message_holds_is_a_fault_at_its_line() {
        let window = |metres: &str, voxel: &str| {
            format!(
                "[mapper]\nvoxel_size_m = {voxel}\nworking_space_m = [100.0, 100.0, 12.0]\n[classifier]\nwindow_m = {metres}\n"
            )
        };
        let shown = faults(&window("[100.0, 101.0, 12.0]", "0.15"));
        let part = "t.toml:5:12: [classifier] window_m = [100.0, 101.0, 12.0]: allowed is at most 451584 cells";
        assert!(shown.contains(part), "{shown}");
        assert!(parse::<Config>(&window("[100.0, 100.0, 12.0]", "0.15")).is_ok());
        assert!(parse::<Config>(&window("[200.0, 200.0, 12.0]", "0.3")).is_ok());
    }

    #[test]
    fn a_section_that_is_absent_or_disabled_is_not_there() {
        let config: Config =
            parse("[graph]\nname = \"x\"\n[mapper]\n[kstore]\nenabled = false\n[bridge]\nenabled = true\n").unwrap();
        assert_eq!(config.process_names(), ["mapper", "bridge"]);
        assert!(faults("[kstore]\nenabled = 3\n").contains("enabled: allowed is true or false"));
    }

    #[test]
    fn a_list_written_as_a_section_and_a_broken_line_say_so() {
        assert!(faults("[ladar]\nname = \"ladar\"\n").contains("write [[ladar]]"));
        assert!(faults("ladar = 3\n").contains("write [[ladar]]"));
        assert!(faults("mapper = 3\n").contains("write [mapper]"));
        assert!(faults("[graph\nname = 3\n").starts_with("t.toml: 1 fault\nt.toml:1:7: "));
    }
}
