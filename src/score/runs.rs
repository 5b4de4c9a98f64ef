//! Runs the program itself, as anybody would, and keeps what it found in a folder so that it need not run twice.
//!
//! In: a ray cloud or a scene's name. Out: a survey's folder with the processor time it took, or a demo's scorecard.

use crate::commands::{Failure, tell};
use crate::files::make_folder;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use tsense_ports::signals;
use tsense_simulator::SceneName;

/// What surveys a plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chain {
    /// Ours.
    Default,
    /// The thesis's: trunks by convolution, on ground by the inverted pyramid and interpolation.
    Thesis,
}

/// How long a drive through a scene takes for its 51 m: a walker's pace.
pub const SCENE_TIME: &str = "50s";

/// Where results are kept.
pub struct Runs {
    folder: PathBuf,
    is_temporary: bool,
}

impl Runs {
    /// Keeps results in a folder, or in a temporary one that goes with the runs.
    ///
    /// From here on an interruption ends the run at hand, not this process, so that the temporary folder goes, too.
    pub fn new(keep: Option<&Path>) -> Result<Self, Failure> {
        signals::install()?;
        let temporary = || std::env::temp_dir().join(format!("tsense-score-{}", std::process::id()));
        let folder = keep.map_or_else(temporary, Path::to_owned);
        make_folder(&folder)?;
        Ok(Self { folder, is_temporary: keep.is_none() })
    }

    /// Surveys rays; the folder, and processor seconds.
    pub fn survey(&self, name: &str, rays: &Path, chain: Chain) -> Result<(PathBuf, f64), Failure> {
        let (detector, ground) = match chain {
            Chain::Default => ("stems", "surface"),
            Chain::Thesis => ("thesis", "interpolation"),
        };
        let out = self.folder.join(format!("{name}-{detector}-{ground}"));
        let clock = out.join("seconds.txt");
        if let Some(seconds) = std::fs::read_to_string(&clock).ok().and_then(|text| text.trim().parse().ok()) {
            return Ok((out, seconds));
        }
        tell(format_args!("tsense: survey of {name}, {detector} on ground by {ground}"));
        let before = children_s();
        let words = ["--crs", "EPSG:32617", "--quiet", "--detector", detector, "--ground", ground];
        let mut command = this()?;
        command.arg("survey").arg(rays).arg("--out").arg(&out).args(words).stdout(Stdio::null());
        finish(command)?;
        let seconds = children_s() - before;
        std::fs::write(&clock, format!("{seconds:.2}\n")).map_err(|e| failed(&clock, e))?;
        Ok((out, seconds))
    }

    /// Records rays of a drive through a scene and surveys them; the folder.
    pub fn scene(&self, scene: SceneName, seed: u64) -> Result<PathBuf, Failure> {
        let name = format!("scene-{}-{seed}", scene.as_str());
        let rays = self.folder.join(format!("{name}.ply"));
        if !rays.exists() {
            let mut command = this()?;
            command.args(["simulate", "--case", "oval", "--for", SCENE_TIME, "--scene", scene.as_str()]);
            command.args(["--seed", &seed.to_string(), "--write-rays"]).arg(&rays);
            finish(command)?;
        }
        Ok(self.survey(&name, &rays, Chain::Default)?.0)
    }

    /// Runs a demo; its scorecard as JSON.
    pub fn demo(&self, scene: SceneName, seed: u64, for_s: f64) -> Result<serde_json::Value, Failure> {
        let file = self.folder.join(format!("live-{}-{seed}.json", scene.as_str()));
        if !file.exists() {
            tell(format_args!("tsense: demo of {} for {for_s} s", scene.as_str()));
            let mut command = this()?;
            command.args(["demo", "--headless", "--quiet", "--json", "--scene", scene.as_str()]);
            command.args(["--seed", &seed.to_string(), "--for", &format!("{for_s}s")]);
            let card = finish(command)?;
            std::fs::write(&file, card).map_err(|e| failed(&file, e))?;
        }
        let bytes = super::read(&file)?;
        serde_json::from_slice(&bytes).map_err(|e| Failure::new(6, format!("{}: {e}", file.display())))
    }
}

impl Drop for Runs {
    fn drop(&mut self) {
        if self.is_temporary {
            // The system's own cleaning takes what cannot be removed now.
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }
}

fn failed(path: &Path, error: std::io::Error) -> Failure {
    Failure::new(1, format!("{}: {error}", path.display()))
}

fn this() -> Result<Command, Failure> {
    let program = std::env::current_exe().map_err(|e| Failure::new(1, format!("where this program lies: {e}")))?;
    Ok(Command::new(program))
}

/// Runs to the end; what it printed.
fn finish(mut command: Command) -> Result<Vec<u8>, Failure> {
    let output = command.stderr(Stdio::piped()).output().map_err(|e| Failure::new(1, e))?;
    if signals::requested().is_some() {
        return Err(Failure::new(130, "interrupted"));
    }
    if output.status.success() {
        return Ok(output.stdout);
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(Failure::new(1, format!("{:?} ended with {}: {}", command.get_args(), output.status, said.trim())))
}

/// Processor seconds of all children that have ended: fields 16 and 17 of `stat`.
fn children_s() -> f64 {
    let ticks = || -> Option<u64> {
        let text = std::fs::read_to_string("/proc/self/stat").ok()?;
        // The second field is the name in parentheses and may hold anything.
        let mut fields = text.rsplit_once(')')?.1.split_whitespace().skip(13);
        Some(fields.next()?.parse::<u64>().ok()? + fields.next()?.parse::<u64>().ok()?)
    };
    ticks().unwrap_or(0) as f64 / rustix::param::clock_ticks_per_second() as f64
}
