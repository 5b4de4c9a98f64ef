//! Access control, management, time and liveness: AS5710.

messages! {
    /// Asks for control of a component, or keeps it.
    RequestControl = 0x000D {
        /// 0 to 255, more is more.
        authority: u8,
    }
    /// Gives control back.
    ReleaseControl = 0x000E {}
    /// The answer to a request for control.
    ConfirmControl = 0x000F {
        /// One of `CONTROL_*`.
        response: u8,
    }
    /// Control was taken away, or given back.
    RejectControl = 0x0010 {
        /// One of `REJECT_*`.
        response: u8,
    }
    /// Sets the authority of a component.
    SetAuthority = 0x0001 {
        /// 0 to 255.
        authority: u8,
    }
    /// Asks who controls.
    QueryControl = 0x200D {}
    /// Who controls; all zero where nobody does.
    ReportControl = 0x400D {
        /// Subsystem of the controller.
        subsystem: u16,
        /// Node of the controller.
        node: u8,
        /// Component of the controller.
        component: u8,
        /// Its authority.
        authority: u8,
    }
    /// Asks for a component's authority.
    QueryAuthority = 0x2001 {}
    /// A component's authority.
    ReportAuthority = 0x4001 {
        /// 0 to 255.
        authority: u8,
    }
    /// Asks after how long control ends.
    QueryTimeout = 0x2003 {}
    /// After how long control ends without another request.
    ReportTimeout = 0x4003 {
        /// Seconds, 0 never.
        timeout_s: u8,
    }
    /// Ends a component.
    Shutdown = 0x0002 {}
    /// Suspends a component.
    Standby = 0x0003 {}
    /// Ends a suspension.
    Resume = 0x0004 {}
    /// Begins anew.
    Reset = 0x0005 {}
    /// Raises an emergency.
    SetEmergency = 0x0006 {
        /// 1 stop; the standard's own example sends 0.
        emergency: u16,
    }
    /// Ends an emergency.
    ClearEmergency = 0x0007 {
        /// 1 stop; the standard's own example sends 0.
        emergency: u16,
    }
    /// Asks for the state of a component.
    QueryStatus = 0x2002 {}
    /// The state of a component.
    ReportStatus = 0x4002 {
        /// One of `STATUS_*`.
        status: u8,
        /// Zero.
        reserved: u32,
    }
    /// Asks whether somebody lives.
    QueryHeartbeatPulse = 0x2202 {}
    /// Somebody lives.
    ReportHeartbeatPulse = 0x4202 {}
    /// Asks for the time.
    QueryTime = 0x2011 {
        /// Bit 0 the time stamp, bit 1 the date stamp.
        wanted: u8,
    }
}

presence! {
    /// The time, UTC.
    ReportTime: u8 {
        /// See [`crate::time_stamp`].
        may time: u32,
        /// See [`crate::date_stamp`].
        may date: u16,
    }
    /// Sets the time, UTC.
    SetTime: u8 {
        /// See [`crate::time_stamp`].
        may time: u32,
        /// See [`crate::date_stamp`].
        may date: u16,
    }
}

message_of_field! { ReportTime = 0x4011 }
message_of_field! { SetTime = 0x0011 }

/// [`ConfirmControl`]: the asker controls now.
pub const CONTROL_ACCEPTED: u8 = 0;
/// [`ConfirmControl`]: control is not to be had.
pub const CONTROL_NOT_AVAILABLE: u8 = 1;
/// [`ConfirmControl`]: somebody with more authority controls, or the component demands more.
pub const CONTROL_INSUFFICIENT: u8 = 2;
/// [`RejectControl`]: control ended.
pub const REJECT_RELEASED: u8 = 0;
/// [`RejectControl`]: there is nothing to give back.
pub const REJECT_NOT_AVAILABLE: u8 = 1;

/// [`ReportStatus`]: coming up.
pub const STATUS_INITIALIZE: u8 = 0;
/// [`ReportStatus`]: at work.
pub const STATUS_READY: u8 = 1;
/// [`ReportStatus`]: suspended.
pub const STATUS_STANDBY: u8 = 2;
/// [`ReportStatus`]: ended.
pub const STATUS_SHUTDOWN: u8 = 3;
/// [`ReportStatus`]: not able to work.
pub const STATUS_FAILURE: u8 = 4;
/// [`ReportStatus`]: in an emergency.
pub const STATUS_EMERGENCY: u8 = 5;
