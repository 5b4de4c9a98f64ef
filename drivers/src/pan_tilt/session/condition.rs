//! How a session is, for the heartbeat: a state and the reason in words.

use super::{Axis, Phase, Session};
use tsense_contract::ProcessState;

impl Session {
    /// How the driver is, in words.
    pub fn condition(&self) -> (ProcessState, String) {
        let degraded = |reason: String| (ProcessState::Degraded, reason);
        match &self.phase {
            Phase::Closed(_) | Phase::Opening if self.lost.is_empty() => {
                (ProcessState::Starting, format!("opening {}", self.config.address))
            }
            Phase::Closed(_) | Phase::Opening => (ProcessState::Stale, self.lost.clone()),
            Phase::Waking(_) | Phase::Surveying(_) | Phase::Arming(_) if !self.lost.is_empty() => {
                (ProcessState::Stale, format!("{}; asking the unit again", self.lost))
            }
            Phase::Waking(_) | Phase::Surveying(_) => (ProcessState::Starting, "asking the unit what it is".into()),
            Phase::Arming(_) => (ProcessState::Starting, "setting up the unit".into()),
            Phase::Done => (ProcessState::Stale, "stopped".into()),
            Phase::Tracking => match (self.limit_hit, &self.may_move, &self.plan_fault, &self.refused) {
                (Some(axis), ..) => degraded(format!("the {axis} axis hit its limit: angles invalid until a reset")),
                (_, Err(reason), ..) => degraded(format!("halted: {reason}")),
                (_, _, Some(fault), _) => degraded(format!("not moving: {fault}")),
                (_, _, _, Some(refused)) => degraded(refused.clone()),
                _ if self.track.newest(Axis::Tilt).is_none() => (ProcessState::Starting, "first poll".into()),
                _ => (ProcessState::Running, if self.config.nod { "nodding" } else { "holding" }.into()),
            },
        }
    }
}
