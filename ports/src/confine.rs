//! Sockets that a library opened without asking where: bound to the loopback device afterwards.
//!
//! In: nothing. Out: every IP socket of this process carries `SO_BINDTODEVICE` `lo`: it neither hears nor reaches anything
//! off this machine, whatever address it is bound to. The kernel enforces it; Linux 5.7 or newer lets any user do so.
#![allow(unsafe_code, reason = "descriptors of other owners are known by number alone")]
#![allow(clippy::disallowed_methods, reason = "shell: /proc is where the descriptors are listed")]

use socket2::SockRef;
use std::io;
use std::os::fd::{BorrowedFd, RawFd};

/// The device.
const LOOPBACK: &[u8] = b"lo";

/// Binds every IPv4 and IPv6 socket of this process to the loopback device. Call it where no other thread opens or closes
/// descriptors. On an error some may be bound and others not: close them all.
pub fn bind_sockets_to_loopback() -> io::Result<()> {
    for entry in std::fs::read_dir("/proc/self/fd")? {
        let path = entry?.path();
        let is_socket = std::fs::read_link(&path).is_ok_and(|to| to.to_string_lossy().starts_with("socket:"));
        let number = path.file_name().and_then(|name| name.to_str()?.parse::<RawFd>().ok());
        let Some(number) = number.filter(|_| is_socket) else { continue };
        // SAFETY: the number was just listed as an open socket. Were it closed meanwhile, the calls below would fail or
        // meet another descriptor of this process, which is then bound to loopback or refused; memory is not touched.
        let socket = unsafe { BorrowedFd::borrow_raw(number) };
        let socket = SockRef::from(&socket);
        let is_ip = socket.local_addr().is_ok_and(|address| address.is_ipv4() || address.is_ipv6());
        if is_ip {
            socket.bind_device(Some(LOOPBACK))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;
    use std::time::Duration;

    #[test]
    fn a_socket_bound_to_all_addresses_hears_this_machine_and_is_bound_to_the_loopback_device() {
        let open = UdpSocket::bind("0.0.0.0:0").unwrap();
        bind_sockets_to_loopback().unwrap();
        assert_eq!(SockRef::from(&open).device().unwrap().as_deref(), Some(LOOPBACK));
        open.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let port = open.local_addr().unwrap().port();
        UdpSocket::bind("127.0.0.1:0").unwrap().send_to(b"near", ("127.0.0.1", port)).unwrap();
        let mut heard = [0; 8];
        assert_eq!(open.recv(&mut heard).unwrap(), 4);
    }
}
