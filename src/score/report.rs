//! `docs/results.md`: every plot by both chains beside the goals and the peers, every scene live, in one file.
//!
//! In: plots with truth, scenes of the simulator. Out: Markdown. The same plots give the same text but for times and the
//! live runs. Sections between `<!-- kept: name -->` and `<!-- /kept -->` are the readers' own and stay as they are.

use super::glance;
use super::goals::{self, Check, Goals};
use super::live;
use super::markdown::{TableText, cm, kept, marked, percent, signed_cm, two};
use super::pairs::Agreement;
use super::plot::PlotScore;
use super::scene::{self, SceneScore};

/// One plot, surveyed by both chains.
pub struct PlotRow {
    /// The folder's name.
    pub name: String,
    /// The seed it was made from.
    pub seed: Option<u64>,
    /// By the default chain.
    pub default: PlotScore,
    /// By the thesis's.
    pub thesis: PlotScore,
    /// Processor seconds for 100,000 rays: default, thesis.
    pub seconds: [f64; 2],
}

/// Seeds of the plots as they come, on which the program was developed.
const DEVELOPED: [u64; 5] = [101, 202, 303, 404, 505];

impl PlotRow {
    /// The default chain against the goals.
    pub fn checks(&self) -> Vec<Check> {
        Goals::of(&self.name).checks(&self.default, Some(self.seconds[0]))
    }

    /// Plots that were developed on come first, then by seed.
    pub fn order(&self) -> (bool, Option<u64>) {
        (!self.is_developed(), self.seed)
    }

    fn is_developed(&self) -> bool {
        self.seed.is_some_and(|seed| DEVELOPED.contains(&seed))
    }

    fn label(&self) -> String {
        let letter = self.name.split('_').next().unwrap_or_default();
        let seed = self.seed.map_or("-".into(), |seed| seed.to_string());
        let developed = if self.is_developed() { ", developed on" } else { "" };
        format!("{letter}, seed {seed}{developed} ({})", self.default.trees)
    }
}

/// Two surveys whose stems were compared.
pub struct Clouds {
    /// What the two are.
    pub names: [String; 2],
    /// Nothing where no motion could be tried.
    pub agreement: Option<Agreement>,
    /// How near stems had to be, metres.
    pub within_m: f64,
}

/// All there is to report.
#[derive(Default)]
pub struct Report {
    /// The plots, in order.
    pub plots: Vec<PlotRow>,
    /// The live runs.
    pub live: Vec<live::LiveRow>,
    /// Surveys of scenes.
    pub scenes: Vec<SceneScore>,
    /// Moving people.
    pub moving: Vec<crate::commands::imaging::MovingRow>,
    /// Real clouds.
    pub clouds: Vec<Clouds>,
    /// The command that made it.
    pub command: String,
}

const LIMITS: &str = "\nNothing was written here yet.\n";

impl Report {
    /// The file; `old` is what it was before.
    pub fn text(&self, old: &str) -> String {
        let mut text = format!(
            "# Results\n\nThis file is made by the program; only the sections between `kept` marks are written by hand.\n\n\
             ```\n{}\n```\n\nFigures in bold miss their goal. Live runs and times differ from run to run, the rest does not.\n\n",
            self.command
        );
        text += &self.glance();
        text += &kept(old, "limits", LIMITS);
        if !self.plots.is_empty() {
            text += &self.plots_text();
        }
        if !self.live.is_empty() {
            text += &live::text(&self.live);
        }
        if !self.scenes.is_empty() {
            text += &scene::text(&self.scenes);
        }
        if !self.moving.is_empty() {
            text += &self.moving_text();
        }
        if !self.clouds.is_empty() {
            text += &self.clouds.iter().map(clouds_text).collect::<String>();
        }
        text + &kept(old, "clouds", LIMITS)
    }

    fn glance(&self) -> String {
        if self.plots.is_empty() && self.live.is_empty() {
            return String::new();
        }
        let mut text = String::from("## At a glance\n\n");
        if !self.plots.is_empty() {
            let checks: Vec<_> = self.plots.iter().map(PlotRow::checks).collect();
            let (all, met) = (checks.iter().flatten().count(), checks.iter().flatten().filter(|c| c.is_met).count());
            text += &format!("{met} of {all} goals are met on {} plots of the default chain:\n\n", self.plots.len());
            text += &glance::table(&checks);
        }
        if !self.live.is_empty() {
            text += &glance::live(&self.live);
        }
        text
    }

    fn plots_text(&self) -> String {
        let [low, high] = goals::SIGMA;
        let mut text = format!(
            "## Plots with truth\n\nSimulated forest plots of an independent scanner simulator (PyPI `sylva-rs` 0.3.0: 0.5 degree \
             grid, 15 mrad beam, 12 mm noise, six stops), surveyed from rays alone with `tsense survey` and its defaults; `thesis` is its whole chain (`--detector thesis --ground interpolation`). \
             Trees pair one to one within 0.3 m of the true axis at 1.3 m; ground is compared over all cells of 0.15 m, \
             brush over cells of 0.3 m. In brackets: true trees.\n\nGoals: precision {:.2}; DBH rms {:.1} cm, {:.1} cm within 8 m of a stop, \
             bias {:.0} cm; ground bias {:.0} cm and no cell unknown; {low:.2} to {high:.2} of the truths within one reported sigma; \
             brush height {:.2} m and F1 {:.1}; {} s of processor time for 100,000 rays.\n\n",
            goals::PRECISION,
            100.0 * goals::DBH_M[0],
            100.0 * goals::DBH_M[1],
            100.0 * goals::BIAS_M[0],
            100.0 * goals::BIAS_M[1],
            goals::BRUSH.0,
            goals::BRUSH.1,
            goals::SECONDS
        );
        text += &self.tree_table();
        text += &self.ground_table();
        text += &self.peer_table();
        text + &self.missed()
    }

    fn tree_table(&self) -> String {
        let mut table = TableText::new(&[
            "plot",
            "detector",
            "precision",
            "recall",
            "F1",
            "goal",
            "position rms, cm",
            "goal",
            "DBH rms, cm",
            "DBH bias, cm",
            "DBH rms within 8 m, cm",
            "DBH within 1 sigma",
        ]);
        for row in &self.plots {
            let (goals, checks) = (Goals::of(&row.name), row.checks());
            let met = |what: &str| checks.iter().find(|check| check.what == what).is_none_or(|check| check.is_met);
            let of = |score: &PlotScore, name: &str, label: String, met: &dyn Fn(&str) -> bool| {
                vec![
                    label,
                    name.to_owned(),
                    marked(two(Some(score.precision)), met("tree precision")),
                    two(Some(score.recall)),
                    marked(two(Some(score.f1)), met("tree F1")),
                    two(Some(goals.f1)),
                    marked(cm(score.position_rmse_m), met("position rms, m")),
                    cm(Some(goals.position_m)),
                    marked(cm(score.dbh_rmse_m), met("DBH rms, m")),
                    marked(signed_cm(score.dbh_bias_m), met("DBH bias, m")),
                    marked(cm(score.near_dbh_rmse_m), met("DBH rms within 8 m, m")),
                    marked(two(score.dbh_within_1_sigma), met("DBH within 1 sigma")),
                ]
            };
            table.row(&of(&row.default, "stems (default)", row.label(), &met));
            table.row(&of(&row.thesis, "thesis", String::new(), &|_| true));
        }
        format!("### Trees\n\n{}", table.end())
    }

    fn ground_table(&self) -> String {
        let mut table = TableText::new(&[
            "plot",
            "ground rms, cm",
            "goal",
            "bias, cm",
            "unknown",
            "within 1 sigma",
            "brush height rms, m",
            "brush precision / recall",
            "brush F1",
            "s for 100,000 rays",
            "thesis: ground rms, cm",
            "bias, cm",
            "s",
        ]);
        for row in &self.plots {
            let (score, goals, checks) = (&row.default, Goals::of(&row.name), row.checks());
            let met = |what: &str| checks.iter().find(|check| check.what == what).is_none_or(|check| check.is_met);
            let shares = score.brush_f1.map(|_| [score.brush_precision, score.brush_recall].map(two).join(" / "));
            table.row(&[
                row.label(),
                marked(cm(score.ground_rmse_m), met("ground rms, m")),
                cm(Some(goals.ground_m)),
                marked(signed_cm(score.ground_bias_m), met("ground bias, m")),
                marked(percent(Some(score.ground_unknown)), met("ground unknown")),
                marked(two(score.ground_within_1_sigma), met("ground within 1 sigma")),
                marked(two(score.brush_height_rmse_m), met("brush height rms, m")),
                shares.unwrap_or("-".into()),
                marked(two(score.brush_f1), met("brush F1")),
                marked(two(Some(row.seconds[0])), met("seconds per 100,000 rays")),
                cm(row.thesis.ground_rmse_m),
                signed_cm(row.thesis.ground_bias_m),
                two(Some(row.seconds[1])),
            ]);
        }
        format!("### Ground, brush and time\n\n{}", table.end())
    }

    /// Peers were measured on the plots' own seeds; the rows of those seeds stand beside them.
    fn peer_table(&self) -> String {
        let mut table = TableText::new(&[
            "plot",
            "program",
            "precision",
            "recall",
            "position rms, cm",
            "DBH rms, cm",
            "ground rms, cm",
        ]);
        let mut rows = 0;
        for row in self.plots.iter().filter(|row| row.is_developed()) {
            let score = &row.default;
            let ours = [score.position_rmse_m, score.dbh_rmse_m, score.ground_rmse_m].map(cm);
            let shares = [score.precision, score.recall].map(|share| two(Some(share)));
            table.row(&[[row.label(), "tsense".into()].as_slice(), &shares, &ours].concat());
            let [rayextract, csf, oracle] = goals::peers_ground_m(&row.name).map(|m| cm(Some(m)));
            let ground = [rayextract.clone(), rayextract, csf, "-".into()];
            for ((name, [p, r, position_m, dbh_m]), ground) in goals::peers(&row.name).into_iter().zip(ground) {
                let figures = [two(Some(p)), two(Some(r)), cm(Some(position_m)), cm(Some(dbh_m)), ground];
                table.row(&[[String::new(), name.into()].as_slice(), &figures].concat());
            }
            table.row(&["", "true ground returns, triangulated", "-", "-", "-", "-", &oracle].map(String::from));
            rows += 1;
        }
        if rows == 0 {
            return String::new();
        }
        format!(
            "### Beside the peers\n\nThe peers' figures were measured beforehand on the same five plots (raycloudtools' rayextract, \
             sylva on its home ground and tuned, 3DFin tuned); they are not measured anew. In the literature: DBH rms 1.9 cm online on a robot \
             (arXiv 2403.17622); 96 % of the trees and 2.3 cm by a personal laser scanner (Gollob 2020); 92.8 % and 1.3 cm from single scans \
             (Wang 2017). Peers' time for 100,000 rays: sylva 1.5 to 4 s, rayextract 2.2 to 3.2 s, 3DFin 1.2 to 2 s.\n\n{}",
            table.end()
        )
    }

    fn missed(&self) -> String {
        let mut text = String::from("### Goals that were missed\n\n");
        for row in &self.plots {
            let said: Vec<String> = row.checks().iter().filter(|check| !check.is_met).map(said).collect();
            if !said.is_empty() {
                text += &format!("- {}: {}\n", row.label(), said.join("; "));
            }
        }
        text + "\n"
    }

    fn moving_text(&self) -> String {
        let mut table = TableText::new(&["scene", "seed", "came, off by, m", "left, off by, m", "false things"]);
        for row in &self.moving {
            let (scene, seed) = (row.scene.to_owned(), row.seed.to_string());
            table.row(&[scene, seed, two(row.came_off_m), two(row.left_off_m), row.false_things.to_string()]);
        }
        let head = "## A person who walked over, by differencing\n\nTwo snapshots of a tripod's map; see [imaging.md](imaging.md).\n\n";
        head.to_owned() + &table.end()
    }
}

/// A goal that was missed, in words.
pub fn said(check: &Check) -> String {
    let bound = match check.range {
        [Some(least), Some(most)] => format!("{least} to {most}"),
        [Some(least), None] => format!("at least {least}"),
        [_, Some(most)] => format!("at most {most}"),
        [None, None] => String::new(),
    };
    let value = check.value.map_or("not measured".to_owned(), |value| format!("{value:.3}"));
    format!("{} {value} ({bound})", check.what)
}

fn clouds_text(clouds: &Clouds) -> String {
    let [a, b] = &clouds.names;
    let mut text = format!("## Stems of two clouds: {a} and {b}\n\n");
    let Some(found) = &clouds.agreement else {
        return text + "No two stems of the one stand as two of the other do; nothing pairs.\n\n";
    };
    text += &format!(
        "{} and {} stems; after a turn of {:.1} degrees {} pair within {:.2} m (distance rms {} m; DBH of the second minus the first: mean {} cm, \
         rms {} cm). The best motion that is clearly another pairs {}: what chance gives.\n\n",
        found.stems[0],
        found.stems[1],
        found.motion.turn_rad.to_degrees().rem_euclid(360.0),
        found.pairs.len(),
        clouds.within_m,
        two(found.distance_rms_m),
        signed_cm(found.dbh_difference_m[0]),
        cm(found.dbh_difference_m[1]),
        found.pairs_by_chance
    );
    let mut table = TableText::new(&["first", "second", "apart, m", "DBH first, cm", "DBH second, cm"]);
    for pair in &found.pairs {
        let [first, second] = pair.dbh_m.map(cm);
        table.row(&[pair.a.to_string(), pair.b.to_string(), two(Some(pair.distance_m)), first, second]);
    }
    text + &table.end()
}
