//! What may be wrong while scans arrive: silence, dirt, a bad status, another setting than the configured one.
//!
//! In: each scan, and the time since the last. Out: measuring, degraded with a reason, or stale and a new connection.

use super::{DEGRADED_PERIODS, FIRST_SCAN_S, RECOVERED_S, STALE_PERIODS, STALE_S, Session, State, Trouble};
use crate::lms151::scan_data::ScanData;
use tsense_geometry::Timestamp;

impl Session {
    pub(super) fn trouble_of(&self, data: &ScanData) -> Trouble {
        let step_e4_deg = data.channel(b"DIST1").map_or(0, |c| c.step_e4_deg);
        let frequency_centihz = data.scan_frequency_centihz;
        let as_wanted = self.settings.measurement.is_none_or(|m| {
            m.scan.frequency_centihz == frequency_centihz && m.scan.step_e4_deg == u32::from(step_e4_deg)
        });
        match data.status {
            _ if !as_wanted => Trouble::NotAsConfigured { frequency_centihz, step_e4_deg },
            _ if (1..=3).contains(&self.contamination) => Trouble::Contaminated(self.contamination),
            [0, 0] => Trouble::None,
            status => Trouble::DeviceStatus(status),
        }
    }

    pub(super) fn judge(&mut self, trouble: Trouble) {
        if trouble == self.trouble && matches!(self.state.0, State::Measuring | State::Degraded) {
            return;
        }
        self.trouble = trouble;
        match trouble {
            Trouble::None => self.enter(State::Measuring, format!("scans arrive in {}", self.speak)),
            trouble => self.enter(State::Degraded, trouble_text(trouble)),
        }
    }

    pub(super) fn stale_after_s(&self) -> f64 {
        STALE_S.max(STALE_PERIODS * self.settings.telegram_period_s)
    }

    pub(super) fn degraded_after_s(&self) -> f64 {
        DEGRADED_PERIODS * self.settings.telegram_period_s
    }

    pub(super) fn watchdog_deadline(&self) -> Timestamp {
        let waiting_for_first = self.state.0 == State::SpinningUp;
        let silent = waiting_for_first || self.trouble == Trouble::Silent;
        self.last_scan.plus_seconds(if silent { self.stale_after_s() } else { self.degraded_after_s() })
    }

    pub(super) fn watchdog(&mut self, now: Timestamp) {
        let silence_s = now.seconds_since(self.last_scan);
        if self.state.0 == State::SpinningUp {
            self.lose(now, format!("no scan within {FIRST_SCAN_S} s of subscribing"));
        } else if silence_s >= self.stale_after_s() {
            self.lose(now, format!("no complete scan for {silence_s:.2} s"));
        } else {
            self.silent_until = now.plus_seconds(RECOVERED_S);
            self.judge(Trouble::Silent);
        }
    }
}

fn trouble_text(trouble: Trouble) -> String {
    match trouble {
        Trouble::None => String::new(),
        Trouble::Silent => "no complete scan for 3 periods".into(),
        Trouble::NotAsConfigured { frequency_centihz, step_e4_deg } => format!(
            "device measures at {} Hz and {} degrees, which is not what is configured",
            f64::from(frequency_centihz) / 100.0,
            f64::from(step_e4_deg) / 1e4
        ),
        Trouble::Contaminated(1) => "window is getting dirty: clean it".into(),
        Trouble::Contaminated(level) => format!("window is dirty (level {level}): distances are not to be trusted"),
        Trouble::DeviceStatus(status) => format!("device status {} {} is not good", status[0], status[1]),
    }
}
