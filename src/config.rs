//! The configuration of a deployment: one TOML file, one section a stage, each section the stage's own struct.
//!
//! In: text. Out: [`Config`], or every fault of every section with its line. Absent keys take the defaults that stand
//! beside the fields; an absent section, or one with `enabled = false`, is a process that is not started. Nothing is
//! repaired.

pub mod nearest;
pub mod parse;
pub mod report;
pub mod survey;

use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use tsense_contract::{Checks, Fault, Grid, Topic};
use tsense_drivers::{lms151, pan_tilt};
use tsense_geometry::VoxelGrid;
use tsense_mapper::LadarMount;
use tsense_ports::logging::LogFormat;

/// The section `[graph]`: what concerns all processes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GraphConfig {
    /// Name of the graph: 1 to 16 out of a-z, 0-9 and -. Two graphs of one user need two names.
    pub name: String,
    /// What is logged: error, warn, info, debug or trace, or a list like `info,tsense_mapper=debug`.
    pub log: String,
    /// How log lines look: human or json.
    pub log_format: LogFormat,
    /// Where the graph keeps files that outlive it, such as the store; empty: `~/.local/state/tsense/NAME`.
    pub state_dir: PathBuf,
    /// Restarts of one process within the window after which the whole graph gives up (exit code 5).
    pub restarts_max: usize,
    /// That window, seconds.
    pub restart_window_s: f64,
}

impl Default for GraphConfig {
    fn default() -> Self {
        Self {
            name: "tsense".into(),
            log: "info".into(),
            log_format: LogFormat::Human,
            state_dir: PathBuf::new(),
            restarts_max: 5,
            restart_window_s: 60.0,
        }
    }
}

impl GraphConfig {
    /// All faults of the section.
    pub fn validate(&self) -> Vec<Fault> {
        let mut check = Checks::default();
        let is_name = tsense_ports::Domain::new(&self.name).is_ok();
        check.require(is_name, "name", &self.name, "1 to 16 characters out of a-z, 0-9 and -");
        check.count("restarts_max", self.restarts_max, 0, 1_000_000, "");
        check.range("restart_window_s", self.restart_window_s, 1.0, 86_400.0, "s");
        check.into_faults()
    }

    /// The folder of the files that outlive the graph.
    pub fn state_dir(&self) -> PathBuf {
        if !self.state_dir.as_os_str().is_empty() {
            return self.state_dir.clone();
        }
        let given = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
        let state = given("XDG_STATE_HOME").or_else(|| Some(given("HOME")?.join(".local/state")));
        state.unwrap_or_else(std::env::temp_dir).join("tsense").join(&self.name)
    }
}

macro_rules! sections {
    ($($(#[$doc:meta])* $field:ident: $config:ty,)+) => {
        /// A whole deployment.
        #[derive(Clone, Debug, Default, PartialEq, Serialize)]
        pub struct Config {
            /// What concerns all processes.
            pub graph: GraphConfig,
            /// One table a ladar.
            #[serde(rename = "ladar", skip_serializing_if = "Vec::is_empty")]
            pub ladars: Vec<lms151::config::Config>,
            $($(#[$doc])* #[serde(skip_serializing_if = "Option::is_none")] pub $field: Option<$config>,)+
            /// The page, and what speaks to other programs.
            #[serde(skip_serializing_if = "Option::is_none")]
            pub bridge: Option<tsense_bridge::Config>,
        }

        impl Config {
            /// A graph of every stage with its defaults, and one ladar.
            pub fn full() -> Self {
                Self {
                    graph: GraphConfig::default(),
                    ladars: vec![Default::default()],
                    $($field: Some(Default::default()),)+
                    bridge: Some(Default::default()),
                }
            }

            /// All faults of all sections, as section and fault; ladars by their position.
            pub fn validate(&self) -> Vec<(String, Fault)> {
                let mut faults: Vec<(String, Fault)> = Vec::new();
                let mut add = |section: &str, found: Vec<Fault>| {
                    faults.extend(found.into_iter().map(|fault| (section.to_owned(), fault)));
                };
                add("graph", self.graph.validate());
                for (i, ladar) in self.ladars.iter().enumerate() {
                    add(&format!("ladar.{i}"), ladar.validate());
                    if self.ladars[..i].iter().any(|other| other.name == ladar.name) {
                        add(&format!("ladar.{i}"), vec![Fault::new("name", &ladar.name, "a name of its own: each ladar is a process")]);
                    }
                }
                if self.mapper.is_some() {
                    for (i, mount) in self.ladar_mounts().iter().enumerate() {
                        add(&format!("ladar.{i}"), mount.validate());
                    }
                }
                $(add(stringify!($field), self.$field.as_ref().map_or_else(Vec::new, |section| section.validate()));)+
                add("classifier", self.grid_fault().into_iter().collect());
                add("kstore", self.sweep_fault().into_iter().collect());
                add("bridge", self.bridge.as_ref().map_or_else(Vec::new, tsense_bridge::Config::validate));
                // The driver and the mapper check the same section: one line a key is enough.
                let mut known = std::collections::BTreeSet::new();
                faults.retain(|(section, fault)| known.insert((section.clone(), fault.key.clone())));
                faults
            }

            /// The processes of this graph in their order of start.
            pub fn process_names(&self) -> Vec<String> {
                let mut names: Vec<String> = self.ladars.iter().map(|ladar| ladar.name.clone()).collect();
                $(if self.$field.is_some() { names.push(stringify!($field).replace('_', "-")); })+
                names.extend(self.outsides());
                names
            }
        }

        impl parse::Sections for Config {
            const NAMES: &'static [&'static str] = &["graph", "ladar", $(stringify!($field),)+ "bridge"];
            fn read(&mut self, name: &str, reader: &mut parse::SectionReader<'_, '_>) {
                match name {
                    "graph" => self.graph = reader.section().unwrap_or_default(),
                    "ladar" => self.ladars = reader.list(),
                    $(stringify!($field) => self.$field = reader.section(),)+
                    "bridge" => self.bridge = reader.section_of_several(),
                    _ => reader.unknown(Self::NAMES),
                }
            }
        }
    };
}

sections! {
    /// The pan-tilt unit; absent: the head is fixed.
    pan_tilt: pan_tilt::Config,
    /// The position system.
    gpos: tsense_drivers::gpos::Config,
    /// The voxel map.
    mapper: tsense_mapper::Config,
    /// What is ground, brush, trunk.
    classifier: tsense_classifier::Config,
    /// The local knowledge store.
    kstore: tsense_kstore::Config,
}

impl Config {
    /// Where each ladar sits and how far it is believed, in the order of the configuration. Without a pan-tilt unit a
    /// ladar's mounting is its place on the vehicle.
    pub fn ladar_mounts(&self) -> Vec<LadarMount> {
        let base = self.pan_tilt.as_ref().map(|unit| unit.mount);
        let mount = |ladar: &lms151::config::Config| LadarMount {
            name: ladar.name.clone(),
            on_pan_tilt: base.is_some(),
            vehicle_from_base: base.unwrap_or_default(),
            tilt_from_ladar: ladar.tilt_from_ladar,
            range_min_m: ladar.range_min_m,
            range_max_m: ladar.range_max_m,
            no_return_range_m: ladar.no_return_range_m,
            weight: ladar.weight,
        };
        self.ladars.iter().map(mount).collect()
    }

    /// Most cells of the grid: a column of voxels each.
    pub fn grid_cells_max(&self) -> Option<usize> {
        let voxels = VoxelGrid::new(self.mapper.as_ref()?.voxel_size_m)?;
        Some(tsense_classifier::Window::columns_max(self.classifier.as_ref()?.window_m, voxels))
    }

    /// What is classified must fit a sample of the topic `grid`, and its size in cells is known to the mapper's voxels.
    fn grid_fault(&self) -> Option<Fault> {
        let cells = self.grid_cells_max().filter(|cells| *cells > Grid::ITEMS_MAX)?;
        let allowed = format!("at most {} cells of mapper.voxel_size_m; these are {cells}", Grid::ITEMS_MAX);
        Some(Fault::new("window_m", format!("{:?}", self.classifier.as_ref()?.window_m), &allowed))
    }

    /// What one sweep of the head shows is one look, however long it takes: the store must wait for the next one.
    fn sweep_fault(&self) -> Option<Fault> {
        let sweep_s = self.pan_tilt.as_ref().filter(|unit| unit.nod)?.sweep_s();
        let sweep_s = Some(sweep_s).filter(|s| s.is_finite())?;
        let span_s = self.kstore.as_ref()?.report_span_s;
        let allowed = format!("longer than a sweep of pan_tilt, which takes {sweep_s:.2} s");
        (span_s <= sweep_s).then(|| Fault::new("report_span_s", span_s, &allowed))
    }

    /// Processes of the bridge, each with a switch of its own: the page is on unless `[bridge]` says `enabled = false`, the
    /// others are off unless their subsection says `enabled = true`.
    pub fn outsides(&self) -> Vec<String> {
        let switches = self.bridge.iter().flat_map(|bridge| {
            [
                ("bridge", bridge.enabled),
                ("jaus", bridge.jaus.enabled),
                ("ros2", bridge.ros2.enabled),
                ("foxglove", bridge.foxglove.enabled),
                ("fleet", bridge.fleet.enabled),
            ]
        });
        switches.filter(|(_, enabled)| *enabled).map(|(name, _)| name.to_owned()).collect()
    }

    /// What ROS is told of where things sit, and how far ladars see.
    pub fn ros2_mounts(&self) -> tsense_bridge::ros2::Mounts {
        let mount = |ladar: &lms151::config::Config| tsense_bridge::ros2::Mount {
            name: ladar.name.clone(),
            range_min_m: ladar.range_min_m,
            range_max_m: ladar.range_max_m,
            tilt_from_ladar: ladar.tilt_from_ladar,
        };
        tsense_bridge::ros2::Mounts {
            pan_tilt: self.pan_tilt.as_ref().map(|unit| unit.mount),
            ladars: self.ladars.iter().map(mount).collect(),
        }
    }

    /// What JAUS is told of the same, and how the pan-tilt unit is driven.
    pub fn jaus_rig(&self) -> tsense_bridge::jaus::Rig {
        let head = |unit: &pan_tilt::Config| tsense_bridge::jaus::Head {
            mount: unit.mount,
            pan_deg: [unit.pan_deg; 2],
            tilt_deg: if unit.nod { [unit.tilt_min_deg, unit.tilt_max_deg] } else { [unit.tilt_hold_deg; 2] },
            speed_deg_s: [unit.pan_rate_deg_s, unit.tilt_rate_deg_s],
        };
        tsense_bridge::jaus::Rig { head: self.pan_tilt.as_ref().map(head), ladars: self.ros2_mounts().ladars }
    }

    /// The configuration as TOML, every key written out.
    pub fn to_toml(&self) -> String {
        to_toml(self)
    }
}

fn to_toml(settings: &impl Serialize) -> String {
    toml::to_string(settings).unwrap_or_else(|e| format!("# not representable as TOML: {e}\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_of_all_stages_are_valid_and_survive_being_written_out() {
        let config = Config::full();
        assert_eq!(config.validate(), vec![]);
        let text = config.to_toml();
        assert_eq!(parse::parse::<Config>(&text).expect("its own text"), config);
    }

    #[test]
    fn processes_are_named_after_their_sections_and_start_with_the_sensors() {
        let names = Config::full().process_names();
        assert_eq!(names, ["ladar", "pan-tilt", "gpos", "mapper", "classifier", "kstore", "bridge"]);
        assert_eq!(Config::default().process_names(), Vec::<String>::new());
        let mut config = Config::full();
        config.bridge.as_mut().expect("a full configuration has it").ros2.enabled = true;
        assert_eq!(config.process_names().last().map(String::as_str), Some("ros2"));
    }

    #[test]
    fn a_store_that_would_report_what_one_slow_sweep_showed_is_a_fault() {
        let faults = |text: &str| match parse::parse::<Config>(text) {
            Ok(_) => vec![],
            Err(reports) => reports.into_iter().map(|report| report.message).collect(),
        };
        let slow = faults("[pan_tilt]\ntilt_rate_deg_s = 10.0\n[kstore]\n");
        let expected = "[kstore] report_span_s = 2.5: allowed is longer than a sweep of pan_tilt, which takes 4.50 s";
        assert_eq!(slow, [expected]);
        for right in [
            "[pan_tilt]\ntilt_rate_deg_s = 10.0\n[kstore]\nreport_span_s = 5.0\n",
            "[pan_tilt]\ntilt_rate_deg_s = 10.0\nnod = false\n[kstore]\n",
            "[kstore]\nreport_span_s = 0.2\n",
        ] {
            assert_eq!(faults(right), Vec::<String>::new(), "{right}");
        }
    }

    #[test]
    fn the_page_and_those_that_speak_to_programs_are_switched_apart() {
        let names = |text: &str| parse::parse::<Config>(text).expect("a configuration").process_names();
        assert_eq!(names("[bridge]\n"), ["bridge"]);
        assert_eq!(names("[bridge.jaus]\nenabled = true\n"), ["bridge", "jaus"]);
        let without_page = "[bridge]\nenabled = false\n";
        assert_eq!(names(without_page), Vec::<String>::new());
        let others = "jaus.enabled = true\nros2.enabled = true\nfoxglove.enabled = true\nfleet.enabled = true\n";
        assert_eq!(names(&format!("{without_page}{others}")), ["jaus", "ros2", "foxglove", "fleet"]);
    }
}
