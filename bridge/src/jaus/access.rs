//! Who controls a component, and in which state it is: AS5710 AccessControl and Management.
//!
//! In: requests with who sent them and when. Out: messages to be sent. Nobody can take control unless the configuration
//! allows it, and only who controls can command; so without that nothing here ever changes.

use tsense_geometry::Timestamp;
use tsense_jaus::message::core::{
    self, CONTROL_ACCEPTED, CONTROL_INSUFFICIENT, CONTROL_NOT_AVAILABLE, ConfirmControl, REJECT_NOT_AVAILABLE,
    REJECT_RELEASED, RejectControl, ReportControl, STATUS_EMERGENCY, STATUS_READY, STATUS_SHUTDOWN, STATUS_STANDBY,
};
use tsense_jaus::{Id, Message};

/// A message and who gets it.
pub type Reply = (Id, Vec<u8>);

/// The rules of control.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// Whether anybody may take control.
    pub allowed: bool,
    /// Least authority that may.
    pub authority: u8,
    /// Seconds without a new request after which control ends; 0 never.
    pub timeout_s: u8,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Holder {
    id: Id,
    authority: u8,
    heard: Timestamp,
}

/// Control and state of one component.
#[derive(Debug)]
pub struct Access {
    rules: Rules,
    authority: u8,
    holder: Option<Holder>,
    status: u8,
    before_emergency: u8,
    changes: u64,
}

impl Access {
    /// Nobody controls, and all is well.
    pub fn new(rules: Rules) -> Self {
        let authority = rules.authority;
        Self { rules, authority, holder: None, status: STATUS_READY, before_emergency: STATUS_READY, changes: 0 }
    }

    /// Takes a request for control.
    pub fn request(&mut self, from: Id, authority: u8, now: Timestamp) -> Vec<Reply> {
        let confirm = |response| (from, ConfirmControl { response }.to_bytes());
        if !self.rules.allowed || self.status == STATUS_SHUTDOWN {
            return vec![confirm(CONTROL_NOT_AVAILABLE)];
        }
        let held = self.holder.filter(|holder| holder.id != from);
        if authority < self.authority || held.is_some_and(|holder| authority <= holder.authority) {
            return vec![confirm(CONTROL_INSUFFICIENT)];
        }
        if self.controller() != Some(from) {
            self.changes += 1;
        }
        self.holder = Some(Holder { id: from, authority, heard: now });
        let lost = held.map(|holder| (holder.id, RejectControl { response: REJECT_RELEASED }.to_bytes()));
        lost.into_iter().chain([confirm(CONTROL_ACCEPTED)]).collect()
    }

    /// Takes control given back.
    pub fn release(&mut self, from: Id) -> Reply {
        let held = self.controller() == Some(from);
        if held {
            self.end_control();
        }
        (from, RejectControl { response: if held { REJECT_RELEASED } else { REJECT_NOT_AVAILABLE } }.to_bytes())
    }

    /// Ends control that was not asked for again in time.
    pub fn tick(&mut self, now: Timestamp) -> Option<Reply> {
        let patience_s = f64::from(self.rules.timeout_s);
        let holder = self.holder.filter(|h| patience_s > 0.0 && now.seconds_since(h.heard) > patience_s)?;
        self.end_control();
        Some((holder.id, RejectControl { response: REJECT_RELEASED }.to_bytes()))
    }

    fn end_control(&mut self) {
        self.holder = None;
        self.authority = self.rules.authority;
        self.changes += 1;
    }

    /// Takes a command that changes the state; an error where the sender may not.
    pub fn command(&mut self, from: Id, code: u16, body: &[u8]) -> Result<(), &'static str> {
        if self.controller() != Some(from) {
            return Err(if self.rules.allowed { "command without control" } else { "commands are not allowed" });
        }
        let malformed = |fault: tsense_jaus::Malformed| fault.as_str();
        self.changes += 1;
        match code {
            core::Shutdown::CODE => {
                self.status = STATUS_SHUTDOWN;
                self.end_control();
            }
            core::Standby::CODE if self.status == STATUS_READY => self.status = STATUS_STANDBY,
            core::Resume::CODE if self.status == STATUS_STANDBY => self.status = STATUS_READY,
            core::Reset::CODE => self.status = STATUS_READY,
            core::SetEmergency::CODE if self.status != STATUS_EMERGENCY => {
                core::SetEmergency::from_bytes(body).map_err(malformed)?;
                self.before_emergency = std::mem::replace(&mut self.status, STATUS_EMERGENCY);
            }
            core::ClearEmergency::CODE if self.status == STATUS_EMERGENCY => self.status = self.before_emergency,
            core::SetAuthority::CODE => {
                let wanted = core::SetAuthority::from_bytes(body).map_err(malformed)?.authority;
                if self.holder.is_none_or(|holder| wanted > holder.authority) {
                    return Err("authority above the controller's");
                }
                self.authority = wanted;
            }
            // A change that is none.
            _ => {}
        }
        Ok(())
    }

    /// Who controls.
    pub fn controller(&self) -> Option<Id> {
        self.holder.map(|holder| holder.id)
    }

    /// One of the standard's states.
    pub fn status(&self) -> u8 {
        self.status
    }

    /// Whether products are sent: not in standby and not after a shutdown. An emergency does not blind anybody.
    pub fn serves(&self) -> bool {
        matches!(self.status, STATUS_READY | STATUS_EMERGENCY)
    }

    /// The authority that control needs now.
    pub fn authority(&self) -> u8 {
        self.authority
    }

    /// Seconds after which control ends.
    pub fn timeout_s(&self) -> u8 {
        self.rules.timeout_s
    }

    /// Counts changes of controller and state.
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// Who controls, as a message; all zero for nobody.
    pub fn report(&self) -> ReportControl {
        self.holder.map_or_else(ReportControl::default, |holder| ReportControl {
            subsystem: holder.id.subsystem(),
            node: holder.id.node(),
            component: holder.id.component(),
            authority: holder.authority,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONSOLE: Id = Id::new(126, 1, 20);
    const CAPTAIN: Id = Id::new(126, 1, 30);

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_seconds(100.0 + seconds)
    }

    fn access(allowed: bool) -> Access {
        Access::new(Rules { allowed, authority: 10, timeout_s: 5 })
    }

    fn confirm(id: Id, response: u8) -> Reply {
        (id, ConfirmControl { response }.to_bytes())
    }

    fn lost(id: Id) -> Reply {
        (id, RejectControl { response: REJECT_RELEASED }.to_bytes())
    }

    #[test]
    fn nobody_takes_control_unless_allowed_and_nobody_commands_without() {
        let mut access = access(false);
        assert_eq!(access.request(CONSOLE, 255, at(0.0)), [confirm(CONSOLE, 1)]);
        for code in [1, 2, 3, 4, 5, 6, 7] {
            assert_eq!(access.command(CONSOLE, code, &[code as u8, 0, 0, 0]), Err("commands are not allowed"));
        }
        assert_eq!((access.changes(), access.status(), access.report()), (0, STATUS_READY, ReportControl::default()));
    }

    #[test]
    fn more_authority_takes_control_over_and_less_does_not() {
        let mut access = access(true);
        assert_eq!(access.request(CONSOLE, 9, at(0.0)), [confirm(CONSOLE, 2)]);
        assert_eq!(access.request(CONSOLE, 200, at(0.0)), [confirm(CONSOLE, 0)]);
        assert_eq!(access.request(CAPTAIN, 200, at(0.0)), [confirm(CAPTAIN, 2)]);
        assert_eq!(access.request(CAPTAIN, 201, at(0.0)), [lost(CONSOLE), confirm(CAPTAIN, 0)]);
        assert_eq!(access.release(CONSOLE).1, [0x10, 0, 1]);
        assert_eq!(access.release(CAPTAIN), lost(CAPTAIN));
        assert_eq!(access.controller(), None);
    }

    #[test]
    fn control_ends_when_it_is_not_asked_for_again() {
        let mut access = access(true);
        access.request(CONSOLE, 200, at(0.0));
        access.request(CONSOLE, 200, at(4.0));
        assert_eq!(access.tick(at(8.9)), None);
        assert_eq!(access.tick(at(9.1)), Some(lost(CONSOLE)));
        assert_eq!(access.tick(at(20.0)), None);
    }

    /// The states of the standard's own example: standby, resume, emergency, clear, resume, standby, release.
    #[test]
    fn the_states_are_those_of_the_capture() {
        let mut access = access(true);
        access.request(CONSOLE, 200, at(0.0));
        let mut go = |code: u16, body: &[u8]| {
            access.command(CONSOLE, code, &[&code.to_le_bytes()[..], body].concat()).unwrap();
            (access.status(), access.serves())
        };
        assert_eq!(go(3, &[]), (STATUS_STANDBY, false));
        assert_eq!(go(4, &[]), (STATUS_READY, true));
        assert_eq!(go(6, &[0, 0]), (STATUS_EMERGENCY, true));
        assert_eq!(go(3, &[]), (STATUS_EMERGENCY, true));
        assert_eq!(go(7, &[0, 0]), (STATUS_READY, true));
        assert_eq!(go(2, &[]), (STATUS_SHUTDOWN, false));
        assert_eq!(access.request(CONSOLE, 200, at(1.0)), [confirm(CONSOLE, 1)]);
        assert_eq!(access.command(CAPTAIN, 4, &[4, 0]), Err("command without control"));
    }
}
