//! Commands to the pan-tilt unit: what is meant, as the bytes that say it.
//!
//! Positions and speeds are the unit's own counts. Every command ends with a space, which every model takes as
//! delimiter. Not used on purpose: `M` (any byte stops it and homes the unit), `A` (holds its answer back until the
//! motion ends), `DS` (wears the memory), the binary mode.
//!
//! Source: wire format notes section 3.3.

use super::answer::Axis;

/// What can be asked of one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// `P`: current position, counts.
    Position,
    /// `R`: seconds of arc per count.
    Resolution,
    /// `N`: least position, counts.
    Least,
    /// `X`: greatest position, counts.
    Greatest,
    /// `L`: slowest speed, counts per second.
    SpeedMin,
    /// `U`: fastest speed, counts per second.
    SpeedMax,
}

/// One command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// `ED`: no echo.
    EchoOff,
    /// `FT`: short answers.
    Terse,
    /// `V`: firmware version.
    Version,
    /// One value of one axis.
    Ask(Axis, Item),
    /// `B`: position and speed of both axes, E-series only.
    AskBoth,
    /// `LE`: position limits enforced.
    LimitsOn,
    /// `I`: position commands are executed at once.
    Immediate,
    /// `CI`: speed is a magnitude, position decides the direction.
    Independent,
    /// `PS`, `TS`: speed of an axis, counts per second.
    Speed(Axis, i32),
    /// `PA`, `TA`: acceleration of an axis, counts per second squared.
    Acceleration(Axis, i32),
    /// `PP`, `TP`: go to a position, counts.
    Go(Axis, i32),
    /// `H`: both axes stop.
    Halt,
    /// `R`: both axes run to their stops and count anew. Moves the head.
    Reset,
}

/// What the answer must hold to be an answer to this command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expect {
    /// Nothing behind the `*`, or words: a command was executed.
    Done,
    /// This many numbers at least.
    Numbers(usize),
    /// Any text.
    Text,
}

fn letter(axis: Axis) -> char {
    match axis {
        Axis::Pan => 'P',
        Axis::Tilt => 'T',
    }
}

impl Command {
    /// The bytes on the wire, delimiter included.
    pub fn to_bytes(self) -> Vec<u8> {
        format!("{self} ").into_bytes()
    }

    /// What its answer must hold.
    pub fn expect(self) -> Expect {
        match self {
            Self::Ask(..) => Expect::Numbers(1),
            Self::AskBoth => Expect::Numbers(4),
            Self::Version => Expect::Text,
            _ => Expect::Done,
        }
    }

    /// Bytes its answer is expected to take at most, for the reply's time limit.
    pub fn answer_bytes(self) -> usize {
        match self {
            Self::Ask(_, Item::Position) => 10,
            Self::AskBoth => 30,
            Self::Go(..) | Self::Speed(..) | Self::Halt => 3,
            // While opening, answers may still be verbose and echoed.
            _ => 90,
        }
    }

    /// How long the unit itself may take beyond the line and the margin, seconds.
    pub fn patience_s(self) -> f64 {
        match self {
            // The unit computes a new table of steps.
            Self::Acceleration(..) => 5.0,
            // The head runs through its whole range.
            Self::Reset => 30.0,
            _ => 0.0,
        }
    }
}

impl std::fmt::Display for Command {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::EchoOff => f.write_str("ED"),
            Self::Terse => f.write_str("FT"),
            Self::Version => f.write_str("V"),
            Self::Ask(axis, item) => {
                let item = match item {
                    Item::Position => 'P',
                    Item::Resolution => 'R',
                    Item::Least => 'N',
                    Item::Greatest => 'X',
                    Item::SpeedMin => 'L',
                    Item::SpeedMax => 'U',
                };
                write!(f, "{}{item}", letter(axis))
            }
            Self::AskBoth => f.write_str("B"),
            Self::LimitsOn => f.write_str("LE"),
            Self::Immediate => f.write_str("I"),
            Self::Independent => f.write_str("CI"),
            Self::Speed(axis, counts) => write!(f, "{}S{counts}", letter(axis)),
            Self::Acceleration(axis, counts) => write!(f, "{}A{counts}", letter(axis)),
            Self::Go(axis, counts) => write!(f, "{}P{counts}", letter(axis)),
            Self::Halt => f.write_str("H"),
            Self::Reset => f.write_str("R"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_read_as_in_the_manual() {
        assert_eq!(Command::Go(Axis::Tilt, -907).to_bytes(), b"TP-907 ");
        assert_eq!(Command::Ask(Axis::Pan, Item::Resolution).to_bytes(), b"PR ");
        assert_eq!(Command::Speed(Axis::Tilt, 389).to_bytes(), b"TS389 ");
        assert_eq!(Command::AskBoth.to_bytes(), b"B ");
    }
}
