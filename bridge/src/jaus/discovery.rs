//! Who we are and what we can do: AS5710 Discovery, the answering side.

use super::config::{Config, Level};
use tsense_jaus::Id;
use tsense_jaus::message::discovery::{
    COMPONENT, COMPONENT_TYPE, ComponentInstance, ComponentServices, NODE, NODE_TYPE, NodeComponents, NodeQuery,
    NodeServices, QueryServiceList, ReportConfiguration, ReportIdentification, ReportServiceList, ReportServices,
    SUBSYSTEM, Service, SubsystemServices, VEHICLE,
};

/// A component and its services.
#[derive(Clone, Debug, PartialEq)]
pub struct Card {
    /// Who.
    pub id: Id,
    /// What.
    pub services: Vec<Service>,
}

fn service(uri: &str, major: u8, minor: u8) -> Service {
    Service { uri: uri.into(), major, minor }
}

/// What every component can do, and the cost map.
fn common() -> Vec<Service> {
    vec![
        service("urn:jaus:jss:core:Transport", 1, 0),
        service("urn:jaus:jss:core:Liveness", 1, 0),
        service("urn:jaus:jss:core:Events", 1, 1),
        service("urn:jaus:jss:core:AccessControl", 1, 1),
        service("urn:jaus:jss:core:Management", 1, 1),
        service("urn:jaus:jss:core:Time", 1, 0),
        service("urn:jaus:jss:iop:CostMap2D", 1, 1),
    ]
}

/// Our components; `pan_tilt` where ladars sit on such a unit.
pub fn cards(config: &Config, pan_tilt: bool) -> [Card; 2] {
    let mut services = common();
    services.push(service("urn:jaus:jss:core:Discovery", 1, 1));
    services.push(service("urn:jaus:jss:environmentSensing:RangeSensor", 1, 0));
    if pan_tilt {
        services.push(service("urn:jaus:jss:manipulator:PanTiltSpecificationService", 1, 0));
        services.push(service("urn:jaus:jss:manipulator:PanTiltJointPositionSensor", 1, 0));
    }
    if config.experimental {
        services.push(service("urn:tsense:experimental:VectorKnowledgeStore", 0, 1));
        services.push(service("urn:tsense:experimental:SmartSensorGrid", 0, 1));
    }
    [Card { id: config.main_id(), services }, Card { id: config.brush_id(), services: common() }]
}

/// Who we are, where we speak for what is asked.
pub fn identification(config: &Config, kind: u8) -> Option<ReportIdentification> {
    let (type_of, speaks) = match kind {
        SUBSYSTEM => (VEHICLE, config.level == Level::Subsystem),
        NODE => (NODE_TYPE, config.level != Level::Component),
        COMPONENT => (COMPONENT_TYPE, true),
        _ => return None,
    };
    speaks.then(|| ReportIdentification { kind, type_of, name: config.name.clone() })
}

/// Our node and its components.
pub fn configuration(cards: &[Card]) -> ReportConfiguration {
    let Some(first) = cards.first() else { return ReportConfiguration::default() };
    let instance = |card: &Card| ComponentInstance { component: card.id.component(), instance: 0 };
    let components = cards.iter().map(instance).collect::<Vec<_>>().into();
    ReportConfiguration { nodes: vec![NodeComponents { node: first.id.node(), components }].into() }
}

/// What the components can do that are asked for; 255 asks for all.
pub fn services(cards: &[Card], query: &[NodeQuery]) -> ReportServices {
    ReportServices { nodes: nodes(cards, |card| asked(query, card.id).then(|| card.services.clone())).into() }
}

fn asked(query: &[NodeQuery], id: Id) -> bool {
    let is = |wanted: u8, ours: u8| wanted == u8::MAX || wanted == ours;
    query.iter().any(|n| is(n.node, id.node()) && n.components.0.iter().any(|c| is(*c, id.component())))
}

/// The same over subsystems, with a filter on names (1.1).
pub fn service_list(cards: &[Card], query: &QueryServiceList) -> ReportServiceList {
    let Some(subsystem) = cards.first().map(|card| card.id.subsystem()) else { return ReportServiceList::default() };
    let is = |wanted: u8, ours: u8| wanted == u8::MAX || wanted == ours;
    let searches = |id: Id| {
        let ours = query.subsystems.0.iter().filter(move |s| s.subsystem == u16::MAX || s.subsystem == subsystem);
        let nodes = ours.flat_map(|s| &s.nodes.0).filter(move |n| is(n.node, id.node()));
        nodes.flat_map(|n| &n.components.0).filter(move |c| is(c.component, id.component()))
    };
    let nodes = nodes(cards, |card| {
        let mut searches = searches(card.id).peekable();
        searches.peek()?;
        let filters: Vec<Option<&String>> = searches.map(|search| search.filter.as_ref()).collect();
        let found = |s: &&Service| filters.iter().any(|filter| filter.is_none_or(|text| s.uri.contains(text.as_str())));
        Some(card.services.iter().filter(found).cloned().collect())
    });
    if nodes.is_empty() {
        return ReportServiceList::default();
    }
    ReportServiceList { subsystems: vec![SubsystemServices { subsystem, nodes: nodes.into() }].into() }
}

/// Our node with the components that have an answer; all of ours are on one node.
fn nodes(cards: &[Card], services: impl Fn(&Card) -> Option<Vec<Service>>) -> Vec<NodeServices> {
    let component = |card: &Card| {
        let services = services(card)?.into();
        Some(ComponentServices { component: card.id.component(), instance: 0, services })
    };
    let components: Vec<ComponentServices> = cards.iter().filter_map(component).collect();
    let node = cards.first().filter(|_| !components.is_empty()).map(|card| card.id.node());
    node.into_iter().map(|node| NodeServices { node, components: components.clone().into() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_jaus::message::discovery::{ComponentSearch, NodeSearch, SubsystemQuery};

    fn query(node: u8, component: u8) -> Vec<NodeQuery> {
        vec![NodeQuery { node, components: vec![component].into() }]
    }

    #[test]
    fn services_are_told_of_whom_is_asked_for() {
        let cards = cards(&Config::default(), false);
        let count = |node, component| {
            let nodes = services(&cards, &query(node, component)).nodes.0;
            nodes.first().map(|n| n.components.0.iter().map(|c| (c.component, c.services.0.len())).collect::<Vec<_>>())
        };
        assert_eq!(count(255, 255), Some(vec![(20, 9), (21, 7)]));
        assert_eq!(count(1, 21), Some(vec![(21, 7)]));
        assert_eq!((count(2, 255), count(1, 99)), (None, None));
    }

    #[test]
    fn what_is_experimental_is_named_so_and_only_where_it_is_served() {
        let named = |experimental| {
            let cards = cards(&Config { experimental, ..Config::default() }, false);
            cards[0].services.iter().filter(|s| s.uri.contains(":experimental:")).count()
        };
        assert_eq!((named(false), named(true)), (0, 2));
    }

    #[test]
    fn a_search_finds_services_by_a_part_of_their_name() {
        let cards = cards(&Config::default(), false);
        let search = |subsystem, filter: Option<&str>| {
            let component = ComponentSearch { component: 255, filter: filter.map(Into::into) };
            let node = NodeSearch { node: 255, components: vec![component].into() };
            let list =
                QueryServiceList { subsystems: vec![SubsystemQuery { subsystem, nodes: vec![node].into() }].into() };
            let found = service_list(&cards, &list).subsystems.0;
            found.first().map(|s| s.nodes.0[0].components.0.iter().map(|c| c.services.0.len()).collect::<Vec<_>>())
        };
        assert_eq!(search(65_535, Some("CostMap2D")), Some(vec![1, 1]));
        assert_eq!((search(1, None), search(2, None)), (Some(vec![9, 7]), None));
    }

    #[test]
    fn the_sensor_speaks_for_as_much_as_its_level_says() {
        let kinds = |level| {
            (1..=4)
                .filter(|kind| identification(&Config { level, ..Config::default() }, *kind).is_some())
                .collect::<Vec<_>>()
        };
        assert_eq!(kinds(Level::Subsystem), [2, 3, 4]);
        assert_eq!((kinds(Level::Node), kinds(Level::Component)), (vec![3, 4], vec![4]));
    }
}
