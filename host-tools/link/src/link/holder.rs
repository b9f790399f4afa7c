//! The program that has a link open, as far as the system reports it. Linux lists the open files of all processes of
//! this user, and to root those of all users; other systems report nothing here.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// Returns the other programs that have the device file open, in words; `None` if the system reports none.
pub(super) fn of_file(path: &Path) -> Option<String> {
    let path = path.canonicalize().ok()?;
    processes_with(&[path])
}

/// Returns the other programs that are connected to one of `ports`, in words; `None` if the system reports none.
pub(super) fn of_ports(ports: &[SocketAddr]) -> Option<String> {
    let tables = ["/proc/net/tcp", "/proc/net/tcp6"].map(std::fs::read_to_string);
    let sockets = tables
        .iter()
        .flatten()
        .flat_map(|table| table.lines().filter_map(|row| socket_to(ports, row)));
    let files: Vec<PathBuf> = sockets.map(|inode| format!("socket:[{inode}]").into()).collect();
    processes_with(&files)
}

/// Returns the inode of the socket in a row of `/proc/net/tcp`, if the socket is connected to one of `ports`.
fn socket_to<'a>(ports: &[SocketAddr], row: &'a str) -> Option<&'a str> {
    /// State of a connection that both ends have open (Linux, `include/net/tcp_states.h`).
    const ESTABLISHED: &str = "01";
    let columns: Vec<&str> = row.split_whitespace().collect();
    let [_, _, remote, state, _, _, _, _, _, inode, ..] = columns[..] else {
        return None;
    };
    let is_one = ports.iter().any(|port| remote == in_table(*port));
    (state == ESTABLISHED && is_one).then_some(inode)
}

/// Returns an address as `/proc/net/tcp` writes it: words of 32 bits in the processor's byte order, in hexadecimal.
fn in_table(port: SocketAddr) -> String {
    let bytes = match port {
        SocketAddr::V4(address) => address.ip().octets().to_vec(),
        SocketAddr::V6(address) => address.ip().octets().to_vec(),
    };
    let (words, _) = bytes.as_chunks::<4>();
    let words = words.iter().map(|word| format!("{:08X}", u32::from_ne_bytes(*word)));
    format!("{}:{:04X}", words.collect::<Vec<_>>().concat(), port.port())
}

/// Returns the other processes that have one of these files open, in words; `None` if there is none.
fn processes_with(files: &[PathBuf]) -> Option<String> {
    let numbers = std::fs::read_dir("/proc")
        .ok()?
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let has_one = |process: &u32| {
        let mut open = std::fs::read_dir(format!("/proc/{process}/fd"))
            .into_iter()
            .flatten()
            .flatten();
        open.any(|open| {
            let target = std::fs::read_link(open.path());
            target.is_ok_and(|target| files.contains(&target))
        })
    };
    let words: Vec<String> = numbers
        .filter(|process| *process != std::process::id() && has_one(process))
        .map(in_words)
        .collect();
    (!words.is_empty()).then(|| words.join(" and "))
}

/// Returns a process's program and number, and the command if it is this one: "`stylus play` (process 7)".
fn in_words(process: u32) -> String {
    let line = std::fs::read(format!("/proc/{process}/cmdline")).unwrap_or_default();
    let line = String::from_utf8_lossy(&line);
    let mut words = line.split('\0');
    let program = Path::new(words.next().unwrap_or_default());
    let program = (program.file_name()).map_or_else(Default::default, |name| name.to_string_lossy());
    let command = match &*program {
        // The first argument that is no general option, such as `-q`.
        "stylus" => words.find(|word| !word.starts_with('-')),
        _ => None,
    };
    match command {
        _ if program.is_empty() => format!("process {process}"),
        Some(command) => format!("`{program} {command}` (process {process})"),
        None => format!("`{program}` (process {process})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_is_found_in_the_systems_table_by_its_other_end() {
        let row = "   3: 0100007F:D2F0 0100007F:1F90 01 00000000:00000000 00:00000000 00000000  1000        0 45678 1";
        let port = |text: &str| text.parse::<SocketAddr>().unwrap();
        let socket = |text: &str, row| socket_to(&[port(text)], row);
        if cfg!(target_endian = "little") {
            assert_eq!(socket("127.0.0.1:8080", row), Some("45678"));
        }
        assert_eq!(socket("127.0.0.1:8081", row), None);
        assert_eq!(socket("127.0.0.2:8080", row), None);
        let closing = row.replace(" 01 ", " 06 ");
        assert_eq!(socket_to(&[port("127.0.0.1:8080")], &closing), None);
        let six = in_table(port("[::1]:80"));
        assert!(six.ends_with(":0050") && six.len() == 37, "{six}");
    }
}
