//! Who is there and what can they do: AS5710.

use super::{List8, List16};

/// Kind of identification: the system.
pub const SYSTEM: u8 = 1;
/// Kind of identification: a subsystem.
pub const SUBSYSTEM: u8 = 2;
/// Kind of identification: a node.
pub const NODE: u8 = 3;
/// Kind of identification: a component.
pub const COMPONENT: u8 = 4;

/// Type of a subsystem that is a vehicle.
pub const VEHICLE: u16 = 10_001;
/// Type of a node.
pub const NODE_TYPE: u16 = 40_001;
/// Type of a component.
pub const COMPONENT_TYPE: u16 = 60_001;

messages! {
    /// Asks who is there.
    QueryIdentification = 0x2B00 {
        /// [`SYSTEM`] to [`COMPONENT`].
        kind: u8,
    }
    /// Who is there.
    ReportIdentification = 0x4B00 {
        /// [`SYSTEM`] to [`COMPONENT`].
        kind: u8,
        /// [`VEHICLE`] and the like.
        type_of: u16,
        /// A name.
        name: String,
    }
    /// Tells a node or a subsystem what a component can do.
    RegisterServices = 0x0B00 {
        /// Its services.
        services: List8<Service>,
    }
    /// Asks which nodes and components there are.
    QueryConfiguration = 0x2B01 {
        /// [`SUBSYSTEM`] or [`NODE`].
        kind: u8,
    }
    /// Which nodes and components there are.
    ReportConfiguration = 0x4B01 {
        /// Node by node.
        nodes: List8<NodeComponents>,
    }
    /// Asks which subsystems there are.
    QuerySubsystemList = 0x2B02 {}
    /// Which subsystems there are.
    ReportSubsystemList = 0x4B02 {
        /// The component of each that knows it.
        subsystems: List8<SubsystemRecord>,
    }
    /// Asks what components can do.
    QueryServices = 0x2B03 {
        /// Of which; 255 is all.
        nodes: List8<NodeQuery>,
    }
    /// What components can do.
    ReportServices = 0x4B03 {
        /// Node by node.
        nodes: List8<NodeServices>,
    }
    /// Asks what components of any subsystem can do (1.1).
    QueryServiceList = 0x2B04 {
        /// Of which; 65535 is all.
        subsystems: List16<SubsystemQuery>,
    }
    /// What components of any subsystem can do (1.1).
    ReportServiceList = 0x4B04 {
        /// Subsystem by subsystem.
        subsystems: List16<SubsystemServices>,
    }
}

records! {
    /// A service and its version.
    Service {
        /// `urn:jaus:jss:...`
        uri: String,
        /// Version before the dot.
        major: u8,
        /// Version behind the dot.
        minor: u8,
    }
    /// A node and its components.
    NodeComponents {
        /// The node.
        node: u8,
        /// Its components.
        components: List8<ComponentInstance>,
    }
    /// A component in a list.
    ComponentInstance {
        /// The component.
        component: u8,
        /// Its instance.
        instance: u8,
    }
    /// A subsystem and who knows it.
    SubsystemRecord {
        /// The subsystem.
        subsystem: u16,
        /// Node of its discovery service.
        node: u8,
        /// Component of its discovery service.
        component: u8,
    }
    /// A node whose services are asked for.
    NodeQuery {
        /// The node; 255 is all.
        node: u8,
        /// Its components; 255 is all.
        components: List8<u8>,
    }
    /// A node and what its components can do.
    NodeServices {
        /// The node.
        node: u8,
        /// Its components.
        components: List8<ComponentServices>,
    }
    /// A component and what it can do.
    ComponentServices {
        /// The component.
        component: u8,
        /// Its instance.
        instance: u8,
        /// Its services.
        services: List8<Service>,
    }
    /// A subsystem whose services are asked for.
    SubsystemQuery {
        /// The subsystem; 65535 is all.
        subsystem: u16,
        /// Its nodes.
        nodes: List8<NodeSearch>,
    }
    /// A node whose services are asked for.
    NodeSearch {
        /// The node; 255 is all.
        node: u8,
        /// Its components.
        components: List8<ComponentSearch>,
    }
    /// A subsystem and what its components can do.
    SubsystemServices {
        /// The subsystem.
        subsystem: u16,
        /// Its nodes.
        nodes: List8<NodeServices>,
    }
}

presence! {
    /// A component whose services are asked for.
    ComponentSearch: u8 {
        /// The component; 255 is all.
        must component: u8,
        /// Only services whose name contains this.
        may filter: String,
    }
}
