//! When a window of evidence ends: with a scan, after a time, or with a nod of the head.
//!
//! In: stamp and nod of each scan. Out: whether the window that is open ends before it.

use crate::config::{EvidenceConfig, WindowRule};
use tsense_geometry::Timestamp;

/// The window that is open.
#[derive(Clone, Debug)]
pub struct EvidenceWindow {
    rule: WindowRule,
    window_s: f64,
    sweep_max_s: f64,
    opened: Option<Timestamp>,
    sweep: Option<u32>,
    /// The last nod took longer than any should: the head stands, and time rules until it moves again.
    head_stands: bool,
}

impl EvidenceWindow {
    /// No window is open.
    pub fn new(config: &EvidenceConfig) -> Self {
        Self {
            rule: config.window,
            window_s: config.window_s,
            sweep_max_s: config.sweep_max_s,
            opened: None,
            sweep: None,
            head_stands: false,
        }
    }

    /// Whether the open window ends before a scan; the scan then opens the next one. `sweep` is nothing for a
    /// ladar that does not nod: it joins the windows of one that does.
    pub fn ends_before(&mut self, stamp: Timestamp, sweep: Option<u32>) -> bool {
        let Some(opened) = self.opened else {
            (self.opened, self.sweep) = (Some(stamp), sweep);
            return false;
        };
        let age_s = stamp.seconds_since(opened);
        let ends = match self.rule {
            WindowRule::Scan => true,
            WindowRule::Time => age_s >= self.window_s,
            WindowRule::Sweep => self.sweep_ends(age_s, sweep),
        };
        self.sweep = sweep.or(self.sweep);
        if ends {
            self.opened = Some(stamp);
        }
        ends
    }

    fn sweep_ends(&mut self, age_s: f64, sweep: Option<u32>) -> bool {
        let turned = sweep.is_some() && self.sweep.is_some() && sweep != self.sweep;
        if turned {
            self.head_stands = false;
            return true;
        }
        if age_s >= self.sweep_max_s {
            self.head_stands = true;
        }
        let by_time = self.head_stands || sweep.or(self.sweep).is_none();
        age_s >= if by_time { self.window_s } else { self.sweep_max_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Instants, in tenths of a second, at which windows end, one scan each tenth.
    fn ends(config: EvidenceConfig, sweep_of: impl Fn(i64) -> Option<u32>) -> Vec<i64> {
        let mut window = EvidenceWindow::new(&config);
        (0..60).filter(|i| window.ends_before(Timestamp::from_ns(i * 100_000_000), sweep_of(*i))).collect()
    }

    fn rule(window: WindowRule) -> EvidenceConfig {
        EvidenceConfig { window, window_s: 0.5, sweep_max_s: 2.0, ..Default::default() }
    }

    #[test]
    fn a_window_ends_with_the_nod() {
        assert_eq!(ends(rule(WindowRule::Sweep), |i| Some(i as u32 / 20)), vec![20, 40]);
    }

    #[test]
    fn a_head_that_stands_or_is_not_there_falls_back_to_time() {
        let stands = ends(rule(WindowRule::Sweep), |_| Some(3));
        assert_eq!(stands[..4], [20, 25, 30, 35]);
        assert_eq!(ends(rule(WindowRule::Sweep), |_| None)[..3], [5, 10, 15]);
    }

    #[test]
    fn a_fixed_ladar_joins_the_windows_of_the_one_that_nods() {
        assert_eq!(ends(rule(WindowRule::Sweep), |i| (i % 2 == 0).then_some(i as u32 / 20)), vec![20, 40]);
    }

    #[test]
    fn a_window_by_time_or_by_scan_does_not_ask_the_head() {
        assert_eq!(ends(rule(WindowRule::Time), |i| Some(i as u32))[..3], [5, 10, 15]);
        assert_eq!(ends(rule(WindowRule::Scan), |_| None).len(), 59);
    }
}
