//! Where a graph can be reached: with the defaults, on this machine alone.
//!
//! Every IP socket of every process of a running graph is looked up in `/proc`. One that is bound to no address must be bound
//! to the loopback device by the kernel, which `ss` alone tells.
#![allow(clippy::disallowed_methods, reason = "tests read /proc")]
#![allow(clippy::print_stdout, reason = "tests tell what they found")]

mod harness;

use harness::world::TestWorld;
use harness::{Folder, PATIENCE, TestGraph, row, tsense};
use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// An IP socket of a process.
#[derive(Clone, Debug)]
struct Socket {
    owner: String,
    local: IpAddr,
    port: u16,
    inode: String,
}

/// A process and all that it started.
fn family(of: u32) -> BTreeSet<u32> {
    let mut family = BTreeSet::from([of]);
    loop {
        let is_child = |pid: &u32| parent(*pid).is_some_and(|parent| family.contains(&parent));
        let found: Vec<u32> = processes().into_iter().filter(|pid| !family.contains(pid)).filter(is_child).collect();
        if found.is_empty() {
            return family;
        }
        family.extend(found);
    }
}

fn processes() -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").unwrap().map_while(Result::ok);
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok()).collect()
}

fn parent(pid: u32) -> Option<u32> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit_once(") ")?.1.split(' ').nth(1)?.parse().ok()
}

/// Inodes of a process's sockets of any kind.
fn inodes(pid: u32) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(format!("/proc/{pid}/fd")) else { return Vec::new() };
    let links = entries.map_while(Result::ok).filter_map(|entry| std::fs::read_link(entry.path()).ok());
    links.filter_map(|to| Some(to.to_str()?.strip_prefix("socket:[")?.trim_end_matches(']').to_owned())).collect()
}

/// All IP sockets of these processes.
fn sockets(pids: &BTreeSet<u32>) -> Vec<Socket> {
    let mut owners = BTreeMap::new();
    for pid in pids {
        let name = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
        owners.extend(inodes(*pid).into_iter().map(|inode| (inode, name.trim_end().to_owned())));
    }
    let mut found = Vec::new();
    for table in ["tcp", "tcp6", "udp", "udp6", "raw", "raw6"] {
        for line in std::fs::read_to_string(format!("/proc/net/{table}")).unwrap_or_default().lines().skip(1) {
            let fields: Vec<&str> = line.split_whitespace().collect();
            if let Some(owner) = owners.get(fields[9]) {
                let (local, port) = fields[1].split_once(':').unwrap();
                let port = u16::from_str_radix(port, 16).unwrap();
                found.push(Socket { owner: owner.clone(), local: address(local), port, inode: fields[9].into() });
            }
        }
    }
    found
}

/// An address as the kernel writes it: words of 32 bits in the machine's order, in hexadecimal.
fn address(hex: &str) -> IpAddr {
    let word = |at: usize| u32::from_str_radix(&hex[at..at + 8], 16).unwrap().to_ne_bytes();
    let bytes: Vec<u8> = (0..hex.len()).step_by(8).flat_map(word).collect();
    match <[u8; 4]>::try_from(&bytes[..]) {
        Ok(bytes) => Ipv4Addr::from(bytes).into(),
        Err(_) => Ipv6Addr::from(<[u8; 16]>::try_from(&bytes[..]).unwrap()).to_canonical(),
    }
}

/// Whether the kernel keeps a socket on the loopback device.
fn is_confined(socket: &Socket) -> bool {
    let Ok(shown) = Command::new("ss").args(["-Haentuw"]).output() else {
        println!("SKIPPED: ss not found; whether {socket:?} is kept on loopback was not looked at");
        return true;
    };
    let inode = format!(" ino:{} ", socket.inode);
    let text = String::from_utf8(shown.stdout).unwrap();
    text.lines().any(|line| line.contains(&inode) && line.contains("%lo:"))
}

/// Fails where something can be reached from elsewhere; returns who has a socket at all.
fn all_are_local(sockets: &[Socket]) -> BTreeSet<String> {
    for socket in sockets {
        let local = socket.local.is_loopback() || (socket.local.is_unspecified() && is_confined(socket));
        assert!(local, "{socket:?} can be reached from other machines");
    }
    sockets.iter().map(|socket| socket.owner.clone()).collect()
}

/// A JAUS port and a DDS domain of this run's own; all else is as by default.
fn outsides() -> String {
    let domain = 80 + std::process::id() % 100;
    format!(
        "[bridge.jaus]\nenabled = true\nlisten = \"127.0.0.1:0\"\n[bridge.ros2]\nenabled = true\ndomain_id = {domain}\n"
    )
}

#[test]
fn with_jaus_and_ros_switched_on_every_socket_is_on_loopback() {
    let world = TestWorld::start();
    let graph = TestGraph::start("", &format!("{}{}", world.sections(), outsides()));
    let at_work = ["ladar", "gpos", "bridge", "jaus", "ros2"];
    graph.wait_until("all who speak to others do", |status| {
        at_work.iter().all(|name| row(status, name)["state"] == "running")
    });
    let owners = all_are_local(&sockets(&family(graph.launcher_pid())));
    println!("processes with IP sockets: {owners:?}");
    assert!(at_work.iter().all(|name| owners.contains(&format!("tsense:{name}"))), "{owners:?}");
    let of_the_library = graph.log().lines().filter(|line| line.contains("rustdds::")).count();
    assert_eq!(of_the_library, 0, "the log is for people:\n{}", graph.log());
    graph.finish();
}

#[test]
fn without_the_page_the_others_are_there() {
    let off = "[bridge]\nenabled = false\n";
    let graph = TestGraph::start("", &format!("[mapper]\n{off}{}", outsides()));
    graph
        .wait_until("both serve", |status| ["jaus", "ros2"].iter().all(|name| row(status, name)["state"] == "running"));
    let owners = all_are_local(&sockets(&family(graph.launcher_pid())));
    assert_eq!(owners, BTreeSet::from(["tsense:jaus".to_owned(), "tsense:ros2".to_owned()]));
    graph.finish();
}

#[test]
fn a_demo_can_be_reached_from_this_machine_alone() {
    let folder = Folder::new("demo");
    let mut demo = tsense(&["demo", "--headless", "--for", "1h", "--keep"]);
    let mut demo = demo.arg(&folder.0).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    let wanted = ["tsense:bridge", "tsense:ladar", "tsense:gpos"];
    loop {
        let found = sockets(&family(demo.id()));
        let owners = all_are_local(&found);
        if wanted.iter().all(|name| owners.contains(*name)) {
            println!("{} IP sockets of {owners:?}", found.len());
            break;
        }
        assert!(start.elapsed() < PATIENCE, "{owners:?}");
        std::thread::sleep(Duration::from_millis(200));
    }
    harness::signal(demo.id(), rustix::process::Signal::TERM);
    assert!(demo.wait().unwrap().success());
}

#[test]
fn what_would_be_open_is_found() {
    let open = std::net::UdpSocket::bind("0.0.0.0:0").unwrap();
    let found = sockets(&BTreeSet::from([std::process::id()]));
    let port = open.local_addr().unwrap().port();
    let socket = found.iter().find(|socket| socket.port == port).expect("the socket of this test");
    assert_eq!(socket.local, IpAddr::from(Ipv4Addr::UNSPECIFIED));
    assert!(Command::new("ss").output().is_err() || !is_confined(socket));
    assert_eq!(address("0100007F"), IpAddr::from(Ipv4Addr::LOCALHOST));
    assert_eq!(address("00000000000000000000000001000000"), IpAddr::from(Ipv6Addr::LOCALHOST));
}
