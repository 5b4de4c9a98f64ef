//! How rmw_zenoh_cpp names things: keys of data, liveliness tokens, qualities of service, attachments. Pure.
//!
//! Source: the design document of rmw_zenoh, and what its peers were seen to send. A component of a token has no slash: `%`
//! stands for one, and for nothing at all.

use super::sink::TopicSpec;

/// The node's name in tokens.
const NODE: &str = "tsense";
/// The depth that needs no saying.
const DEFAULT_DEPTH: usize = 42;

/// Key of a topic's data.
pub fn data_key(domain: u16, topic: &TopicSpec) -> String {
    format!("{domain}/{}/{}/{}", topic.name.trim_start_matches('/'), topic.dds_type(), topic.type_hash)
}

/// Token of the node: entity 0 of the session.
pub fn node_token(domain: u16, session: &str) -> String {
    format!("@ros2_lv/{domain}/{session}/0/0/NN/%/%/{NODE}")
}

/// Token of a publisher, entity `entity` of the session.
pub fn publisher_token(domain: u16, session: &str, entity: usize, topic: &TopicSpec) -> String {
    let name = topic.name.replace('/', "%");
    let (kind, hash, qos) = (topic.dds_type(), topic.type_hash, qos(topic));
    format!("@ros2_lv/{domain}/{session}/0/{entity}/MP/%/%/{NODE}/{name}/{kind}/{hash}/{qos}")
}

/// Where a latched topic's publisher answers who joins late: under the prefix of `zenoh-ext`'s advanced publishers, as one
/// whose samples carry a time and no number.
pub fn history_key(data_key: &str, session: &str) -> String {
    format!("{data_key}/@adv/pub/{session}/uhlc/_")
}

/// Reliability, durability, history and depth, deadline, lifespan, liveliness; what is the default is left out.
fn qos(topic: &TopicSpec) -> String {
    let reliability = if topic.reliable { "" } else { "2" };
    let durability = if topic.transient_local { "1" } else { "" };
    let depth = if topic.depth == DEFAULT_DEPTH { String::new() } else { topic.depth.to_string() };
    format!("{reliability}:{durability}:,{depth}:,:,:,,")
}

/// What travels with a sample: its number from 1, its time, and the publisher's id.
pub fn attachment(sequence: i64, source_ns: i64, gid: [u8; 16]) -> [u8; 33] {
    let mut bytes = [0; 33];
    bytes[..8].copy_from_slice(&sequence.to_le_bytes());
    bytes[8..16].copy_from_slice(&source_ns.to_le_bytes());
    bytes[16] = 16;
    bytes[17..].copy_from_slice(&gid);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::config::Config;
    use crate::ros2::messages::{LaserScan, OccupancyGrid, RosMessage};

    #[test]
    fn keys_and_tokens_are_those_of_rmw_zenoh() {
        let config = Config::default();
        let grid = TopicSpec::of::<OccupancyGrid>(&config, &config.topics.traversability, "");
        let hash = OccupancyGrid::HASH;
        let kind = "nav_msgs::msg::dds_::OccupancyGrid_";
        assert_eq!(data_key(7, &grid), format!("7/tsense/traversability/{kind}/{hash}"));
        assert_eq!(node_token(7, "ab12"), "@ros2_lv/7/ab12/0/0/NN/%/%/tsense");
        let expected = format!("@ros2_lv/7/ab12/0/3/MP/%/%/tsense/%tsense%traversability/{kind}/{hash}/:1:,1:,:,:,,");
        assert_eq!(publisher_token(7, "ab12", 3, &grid), expected);
        let scan = TopicSpec::of::<LaserScan>(&config, &config.topics.scan, "");
        assert!(publisher_token(7, "ab12", 4, &scan).ends_with("/2::,5:,:,:,,"));
    }

    #[test]
    fn an_attachment_is_number_time_and_id_with_its_length() {
        let bytes = attachment(1, 2, std::array::from_fn(|i| 0x20 + i as u8));
        assert_eq!((bytes[0], bytes[8], bytes[16], bytes[17], bytes[32]), (1, 2, 16, 0x20, 0x2f));
    }
}
