//! Where a survey's processor time goes: seconds by stage.
//!
//! In: the calling thread's own clock, asked when a stage ends. Out: seconds of that thread's work, the kernel's included. They
//! differ from run to run, so they are told on stdout and stand in no file.

use rustix::time::{ClockId, clock_gettime};
use std::collections::BTreeMap;

/// Seconds by stage.
pub struct Stages {
    ended_s: f64,
    seconds: BTreeMap<&'static str, f64>,
}

impl Stages {
    /// The first stage begins.
    pub fn begin() -> Self {
        Self { ended_s: processor_s(), seconds: BTreeMap::new() }
    }

    /// A stage ends, the next one begins. What has one name counts together.
    pub fn end(&mut self, stage: &'static str) {
        let now_s = processor_s();
        *self.seconds.entry(stage).or_insert(0.0) += now_s - std::mem::replace(&mut self.ended_s, now_s);
    }

    /// Seconds by stage.
    pub fn seconds(self) -> BTreeMap<&'static str, f64> {
        self.seconds
    }
}

/// Processor time of this thread, seconds: a survey has one.
fn processor_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_share_the_time_between_their_ends() {
        let before_s = processor_s();
        let mut stages = Stages::begin();
        let mut sum = 0u64;
        for stage in ["a", "b", "a"] {
            (0..2_000_000u64).for_each(|i| sum = std::hint::black_box(sum.wrapping_mul(31).wrapping_add(i)));
            stages.end(stage);
        }
        let (seconds, all_s) = (stages.seconds(), processor_s() - before_s);
        let told_s: f64 = seconds.values().sum();
        assert!(seconds["a"] > seconds["b"] && told_s <= all_s, "{seconds:?} of {all_s}");
    }
}
