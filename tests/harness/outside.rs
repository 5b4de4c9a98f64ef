//! Processes that speak to the outside: page, JAUS, ROS 2 and (where it is built in) Foxglove.

/// A DDS domain of this run's own.
pub fn domain() -> u32 {
    20 + std::process::id() % 200
}

/// Their names.
pub fn names() -> Vec<&'static str> {
    let foxglove = cfg!(feature = "foxglove").then_some("foxglove");
    ["bridge", "jaus", "ros2"].into_iter().chain(foxglove).collect()
}

/// What switches them on but the page, behind `[bridge]`.
pub fn sections() -> String {
    let any = "listen = \"127.0.0.1:0\"\n";
    let ros2 = format!("[bridge.ros2]\nenabled = true\ndomain_id = {}\n", domain());
    let mut sections = format!("[bridge.jaus]\nenabled = true\n{any}{ros2}");
    if cfg!(feature = "foxglove") {
        sections += &format!("[bridge.foxglove]\nenabled = true\n{any}");
    }
    sections
}
