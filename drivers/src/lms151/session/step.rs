//! The conversation's script: which request each step makes, and which step an answer leads to.
//!
//! Pure tables: no time, no bytes. The order is that of the protocol notes 1.3: log in, stop, set, start, log out, wait until it
//! measures, subscribe. A device that already turns as wanted is not stopped: a change costs up to 30 s of spinning up.

use super::{Goal, Settings, State};
use crate::lms151::commands::{Reply, Request, STATUS_MEASURING, ScanConfig, Variable, scan_config_refusal};
use crate::lms151::fault_code::FaultCode;

/// Where the conversation is. Each step but the last two is one request and its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    FindDialect,
    Identify,
    StopStream,
    ReadStatus,
    LogIn,
    ReadScanConfig,
    StopMeasuring,
    SetScanConfig,
    SetDataConfig,
    SetOutputRange,
    StartMeasuring,
    LogOut,
    AwaitMeasuring,
    Subscribe,
    /// Scans arrive; contamination is asked for now and then.
    Streaming,
    EnterStandby,
    LeaveForStandby,
    /// Laser and motor are off, on request.
    StandingBy,
    /// Cancelling the stream before closing.
    Closing,
}

/// What follows an answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Next {
    Go(Step),
    /// Make the same request again, after a pause.
    Poll,
    /// The device will not do what is needed: why, and what to do.
    Refused(String),
}

impl Step {
    /// The request of this step; `None` where there is none, or nothing configured to set.
    pub fn request(self, settings: &Settings) -> Option<Request> {
        let measurement = settings.measurement;
        Some(match self {
            Self::FindDialect => Request::Read(Variable::FirmwareVersion),
            Self::Identify => Request::Read(Variable::DeviceIdent),
            Self::StopStream | Self::Closing => Request::Stream(false),
            Self::ReadStatus | Self::AwaitMeasuring => Request::Read(Variable::Status),
            Self::LogIn => Request::LogIn,
            Self::ReadScanConfig => Request::Read(Variable::ScanConfig),
            Self::StopMeasuring => Request::StopMeasuring,
            Self::SetScanConfig => Request::SetScanConfig(measurement?.scan),
            Self::SetDataConfig => Request::SetDataConfig(measurement?.data),
            Self::SetOutputRange => Request::SetOutputRange { step_e4_deg: measurement?.scan.step_e4_deg },
            Self::StartMeasuring => Request::StartMeasuring,
            Self::LogOut | Self::LeaveForStandby => Request::Run,
            Self::Subscribe => Request::Stream(true),
            Self::Streaming => Request::Read(Variable::Contamination),
            Self::EnterStandby => Request::Standby,
            Self::StandingBy => return None,
        })
    }

    /// The state people see during this step.
    pub fn state(self) -> State {
        match self {
            Self::FindDialect | Self::Identify | Self::StopStream | Self::ReadStatus => State::Connecting,
            Self::LogIn => State::LoggingIn,
            Self::AwaitMeasuring | Self::Subscribe => State::SpinningUp,
            Self::Streaming => State::Measuring,
            Self::EnterStandby | Self::LeaveForStandby | Self::StandingBy => State::Standby,
            Self::Closing => State::Closed,
            _ => State::Configuring,
        }
    }

    /// Asked once, and nothing depends on the answer.
    pub fn is_courtesy(self) -> bool {
        matches!(self, Self::Identify | Self::Streaming)
    }

    /// The step after an answer.
    pub fn after(self, reply: &Reply, goal: Goal, settings: &Settings) -> Next {
        use Step::*;
        Next::Go(match (self, reply) {
            (LogIn, Reply::Number(0)) => {
                return Next::Refused(
                    "log-in as authorised client refused: another password is set on the device".into(),
                );
            }
            (ReadStatus, Reply::Number(state)) if *state == u32::from(STATUS_MEASURING) => Subscribe,
            (AwaitMeasuring, Reply::Number(state)) if *state != u32::from(STATUS_MEASURING) => return Next::Poll,
            (ReadScanConfig, Reply::ScanConfig { config, .. }) if turns_as_wanted(config, settings) => SetDataConfig,
            (SetScanConfig, Reply::ScanConfig { status, .. }) if *status != 0 => {
                return Next::Refused(format!(
                    "rate and resolution refused, status {status} ({}): set frequency_hz and resolution_deg to a pair this \
                     device takes",
                    scan_config_refusal(*status)
                ));
            }
            (EnterStandby, Reply::Number(result)) if *result != 0 => {
                return Next::Refused(format!("standby refused with result {result}"));
            }
            _ => self.following(goal, settings),
        })
    }

    /// The step after this one when nothing special was answered.
    pub fn following(self, goal: Goal, settings: &Settings) -> Step {
        use Step::*;
        match self {
            FindDialect => Identify,
            Identify => StopStream,
            StopStream if goal == Goal::Measure && settings.measurement.is_none() => ReadStatus,
            StopStream | ReadStatus => LogIn,
            LogIn if goal == Goal::StandBy => EnterStandby,
            LogIn if settings.measurement.is_none() => StartMeasuring,
            LogIn => ReadScanConfig,
            ReadScanConfig => StopMeasuring,
            StopMeasuring => SetScanConfig,
            SetScanConfig => SetDataConfig,
            SetDataConfig => SetOutputRange,
            SetOutputRange => StartMeasuring,
            StartMeasuring => LogOut,
            LogOut => AwaitMeasuring,
            AwaitMeasuring => Subscribe,
            Subscribe | Streaming => Streaming,
            EnterStandby => LeaveForStandby,
            LeaveForStandby | StandingBy => StandingBy,
            Closing => Closing,
        }
    }

    /// The step after an error answer without a remedy. What the device does not know it need not do, as long as the scans
    /// themselves show how it measures; what it knows and refuses is the user's to mend.
    pub fn after_fault(self, code: FaultCode, goal: Goal, settings: &Settings) -> Next {
        use Step::*;
        let passable = match self {
            FindDialect | Identify | StopStream | Streaming | Closing | ReadStatus => true,
            ReadScanConfig | StopMeasuring | SetScanConfig | SetOutputRange | LogOut | AwaitMeasuring => {
                code.is_unknown()
            }
            _ => false,
        };
        if passable {
            return Next::Go(self.following(goal, settings));
        }
        let name = self.request(settings).map_or("a request", |r| r.name());
        Next::Refused(format!(
            "{name} answered with {code}: check that this is an LMS1xx and what its configuration allows"
        ))
    }
}

fn turns_as_wanted(config: &ScanConfig, settings: &Settings) -> bool {
    // The range is fixed on this family; devices report it some ten-thousandths of a degree off.
    settings.measurement.is_none_or(|wanted| {
        wanted.scan.frequency_centihz == config.frequency_centihz && wanted.scan.step_e4_deg == config.step_e4_deg
    })
}
