//! What a process uses of the machine: share of a core and resident memory, from `/proc`.
#![allow(clippy::disallowed_methods, reason = "shell: /proc")]

/// Shortest span a share is measured over, seconds: the kernel counts in hundredths.
const SPAN_MIN_S: f64 = 0.4;

/// Usage of one process.
#[derive(Clone, Debug, Default)]
pub(super) struct Usage {
    /// Share of one core, 1 a whole one.
    pub(super) cpu: f32,
    /// Resident memory, bytes.
    pub(super) rss_bytes: u64,
    last: Option<(f64, u64)>,
}

impl Usage {
    /// Reads the present figures of a process.
    pub(super) fn measure(&mut self, pid: u32, now_s: f64) {
        self.rss_bytes = resident_bytes(pid).unwrap_or(0);
        let Some(ticks) = cpu_ticks(pid) else { return };
        match self.last {
            Some((then_s, then)) if now_s - then_s >= SPAN_MIN_S => {
                let seconds = ticks.saturating_sub(then) as f64 / rustix::param::clock_ticks_per_second() as f64;
                self.cpu = (seconds / (now_s - then_s)) as f32;
                self.last = Some((now_s, ticks));
            }
            Some(_) => {}
            None => self.last = Some((now_s, ticks)),
        }
    }
}

/// Processor time in user and kernel mode: fields 14 and 15 of `stat`.
fn cpu_ticks(pid: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The second field is the name in parentheses and may hold anything.
    let mut fields = text.rsplit_once(')')?.1.split_whitespace().skip(11);
    Some(fields.next()?.parse::<u64>().ok()? + fields.next()?.parse::<u64>().ok()?)
}

fn resident_bytes(pid: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/statm")).ok()?;
    Some(text.split(' ').nth(1)?.parse::<u64>().ok()? * rustix::param::page_size() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_works_uses_the_processor_and_memory() {
        let mut usage = Usage::default();
        let me = std::process::id();
        usage.measure(me, 0.0);
        let before = cpu_ticks(me).unwrap();
        while cpu_ticks(me).unwrap() < before + 10 {
            std::hint::black_box((0..10_000).sum::<u64>());
        }
        usage.measure(me, 0.5);
        // Ten ticks of a hundredth within what it is told was half a second; other tests share this process.
        assert!(usage.cpu >= 0.2, "{}", usage.cpu);
        assert!(usage.rss_bytes > 1_000_000);
        assert!(cpu_ticks(u32::MAX).is_none());
    }
}
