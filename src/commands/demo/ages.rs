//! How old detections are when a reader gets them: a reader of its own, waked by each as any consumer is.
//!
//! In: the graph's domain. Out: percentiles at the end. The demo's own loop looks at its topics ten times a second only, and
//! would count its waiting as age.

use super::scorecard::{AgeLog, Ages};
use crate::commands::tell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use tsense_contract::Detections;
use tsense_geometry::Timestamp;
use tsense_ports::{Domain, PortError, Process, Wake};

/// How often the reader looks whether it is to end, graph seconds.
const LOOK_S: f64 = 0.2;

/// The reader.
pub struct AgeReader {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<AgeLog, PortError>>>,
}

impl AgeReader {
    /// Starts to read the detections of a graph that runs.
    pub fn start(domain: Domain) -> std::io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let until = stop.clone();
        let thread = std::thread::Builder::new().name("ages".into()).spawn(move || read(&domain, &until))?;
        Ok(Self { stop, thread: Some(thread) })
    }

    /// Ends the reader: the ages so far; none where it could not read.
    pub fn finish(&mut self) -> Ages {
        self.stop.store(true, Ordering::Relaxed);
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Ok(log))) => log.ages(),
            Some(Ok(Err(error))) => {
                tell(format_args!("tsense: ages of detections were not measured: {error}"));
                Ages::default()
            }
            Some(Err(_)) | None => Ages::default(),
        }
    }
}

impl Drop for AgeReader {
    fn drop(&mut self) {
        self.finish();
    }
}

fn read(domain: &Domain, stop: &AtomicBool) -> Result<AgeLog, PortError> {
    let mut process = Process::observe(domain, "demo-ages")?;
    let mut detections = process.inbox::<Detections>(None)?;
    let mut log = AgeLog::default();
    while !stop.load(Ordering::Relaxed) && process.wait(LOOK_S) != Wake::Stop {
        while let Some(sample) = detections.take()? {
            let newest = Timestamp::from_ns(sample.header().stamp_ns);
            log.add(process.clock().now().seconds_since(newest) * 1e3);
        }
    }
    Ok(log)
}
