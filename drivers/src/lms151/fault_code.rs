//! The codes of `sFA` error answers: what each means, and what a driver may do about it.
//!
//! In: the code. Out: a name, and whether to log in again, to ask again, or to give up. Source: protocol notes 1.2.

use std::fmt;

/// The code of an error answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultCode(pub u16);

/// What a driver may do about an error answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    /// The log-in is missing or has run out.
    LogInAgain,
    /// The device is busy for now.
    AskAgain,
    /// The same request will be refused again.
    None,
}

const NAMES: [&str; 0x1B] = [
    "no error",
    "access denied, not logged in",
    "unknown method",
    "unknown variable",
    "value out of range or wrong state",
    "invalid data",
    "unknown error",
    "buffer overflow",
    "parameter missing",
    "unknown type",
    "writing this variable is denied",
    "unknown command for the name server",
    "unknown CoLa command",
    "device is busy",
    "array index out of bounds",
    "unknown event",
    "CoLa-A value too large",
    "CoLa-A character not allowed",
    "no message from the operating system",
    "no answer from the operating system",
    "internal fault",
    "hub address fault 15",
    "hub address fault 16",
    "hub address fault 17",
    "hub address fault 18",
    "asynchronous methods suppressed",
    "complex arrays not supported",
];

impl FaultCode {
    /// Its meaning in words.
    pub fn name(self) -> &'static str {
        NAMES.get(usize::from(self.0)).copied().unwrap_or("a code this driver does not know")
    }

    /// What to do about it.
    pub fn remedy(self) -> Remedy {
        match self.0 {
            0x1 => Remedy::LogInAgain,
            0xD => Remedy::AskAgain,
            _ => Remedy::None,
        }
    }

    /// The device does not know what it was asked: another family member, or an older firmware.
    pub fn is_unknown(self) -> bool {
        matches!(self.0, 0x2 | 0x3 | 0xF)
    }
}

impl fmt::Display for FaultCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error {:X} ({})", self.0, self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_have_the_names_of_the_table() {
        assert_eq!(FaultCode(0x1).to_string(), "error 1 (access denied, not logged in)");
        assert_eq!(FaultCode(0xD).to_string(), "error D (device is busy)");
        assert_eq!(FaultCode(0xF).name(), "unknown event");
        assert_eq!(FaultCode(0x10).name(), "CoLa-A value too large");
        assert_eq!(FaultCode(0x14).name(), "internal fault");
        assert_eq!(FaultCode(0x19).name(), "asynchronous methods suppressed");
        assert_eq!(FaultCode(0x1A).name(), "complex arrays not supported");
        assert_eq!(FaultCode(0xFFFF).name(), "a code this driver does not know");
    }

    #[test]
    fn only_the_log_in_and_the_busy_device_have_a_remedy() {
        let with_remedy: Vec<u16> = (0..=0xFFFF).filter(|c| FaultCode(*c).remedy() != Remedy::None).collect();
        assert_eq!(with_remedy, [0x1, 0xD]);
    }
}
