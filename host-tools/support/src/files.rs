//! Files by path: those of the disk, and files in memory below folders that a program mounts. Where no disk is, as on a
//! page, a mount of the empty path holds all files.
//!
//! Readers and writers take a path and know no difference, so that a reader has one form, and one set of words for what
//! is wrong.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::io::{self, Cursor, Read, Seek, SeekFrom, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};

/// Content of a file in memory.
pub type Bytes = Arc<[u8]>;

/// What is in memory.
struct Memory {
    mounts: Vec<PathBuf>,
    files: BTreeMap<PathBuf, Bytes>,
}

static MEMORY: RwLock<Memory> = RwLock::new(Memory {
    mounts: Vec::new(),
    files: BTreeMap::new(),
});

impl Memory {
    fn is_place_of(&self, path: &Path) -> bool {
        // A command mounts nothing, and reads up to a million paths.
        !self.mounts.is_empty() && self.mounts.iter().any(|mount| plain(path).starts_with(mount))
    }
}

/// What a path leads to.
enum Place {
    Disk,
    Held(Bytes),
    Folder,
    Nothing,
}

/// Keeps all files at and below `folder` in memory from now on.
pub fn mount(folder: &Path) {
    with(|memory| memory.mounts.push(plain(folder)));
}

/// Returns whether the file at `path` is, or would be, one in memory.
pub fn is_in_memory(path: &Path) -> bool {
    MEMORY.read().unwrap_or_else(PoisonError::into_inner).is_place_of(path)
}

/// Keeps a file in memory, in the place of an earlier one.
pub fn put(path: &Path, bytes: impl Into<Bytes>) {
    let bytes = bytes.into();
    with(|memory| memory.files.insert(plain(path), bytes));
}

/// Removes the file in memory at `path`, or all files of the folder there.
pub fn remove(path: &Path) {
    let path = plain(path);
    with(|memory| memory.files.retain(|file, _| !file.starts_with(&path)));
}

/// Returns the content of the file in memory at `path`.
pub fn held(path: &Path) -> Option<Bytes> {
    match place(path) {
        Place::Held(bytes) => Some(bytes),
        _ => None,
    }
}

/// Returns the files in memory at and below `path`, in the order of their names.
pub fn below(path: &Path) -> Vec<(PathBuf, Bytes)> {
    let path = plain(path);
    MEMORY
        .read()
        .unwrap_or_else(PoisonError::into_inner)
        .files
        .iter()
        .filter(|(file, _)| file.starts_with(&path))
        .map(|(file, bytes)| (file.clone(), bytes.clone()))
        .collect()
}

fn with<R>(change: impl FnOnce(&mut Memory) -> R) -> R {
    // A panic of another thread leaves the map whole.
    change(&mut MEMORY.write().unwrap_or_else(PoisonError::into_inner))
}

/// Returns `path` without `.` and `..`, as the map has it.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if plain.file_name().is_some() => {
                plain.pop();
            }
            part => plain.push(part),
        }
    }
    plain
}

fn place(path: &Path) -> Place {
    let memory = MEMORY.read().unwrap_or_else(PoisonError::into_inner);
    if !memory.is_place_of(path) {
        return Place::Disk;
    }
    let path = plain(path);
    if let Some(bytes) = memory.files.get(&path) {
        return Place::Held(bytes.clone());
    }
    // Files of a folder follow its path in the map's order.
    match memory.files.range(path.clone()..).next() {
        Some((file, _)) if file.starts_with(&path) => Place::Folder,
        _ => Place::Nothing,
    }
}

fn absent() -> io::Error {
    // The words of the systems on which the command runs.
    io::Error::new(io::ErrorKind::NotFound, "No such file or directory (os error 2)")
}

/// What is known of a file or folder without opening it.
pub struct Found {
    /// Size of a file, bytes.
    pub len: u64,
    /// What is there, as a noun with its article, if it is not a regular file.
    pub other: Option<&'static str>,
}

/// Returns what is at `path`.
pub fn found(path: &Path) -> io::Result<Found> {
    match place(path) {
        Place::Disk => fs::metadata(path).map(|found| Found {
            len: found.len(),
            other: other_than_a_file(&found),
        }),
        Place::Held(bytes) => Ok(Found {
            len: bytes.len() as u64,
            other: None,
        }),
        Place::Folder => Ok(Found {
            len: 0,
            other: Some(FOLDER),
        }),
        Place::Nothing => Err(absent()),
    }
}

/// Returns whether something is at `path`.
pub fn exists(path: &Path) -> bool {
    found(path).is_ok()
}

/// Returns whether a regular file is at `path`.
pub fn is_file(path: &Path) -> bool {
    found(path).is_ok_and(|found| found.other.is_none())
}

/// Returns whether a folder is at `path`.
pub fn is_dir(path: &Path) -> bool {
    found(path).is_ok_and(|found| found.other == Some(FOLDER))
}

const FOLDER: &str = "a folder";

/// Returns what is at a path, as a noun with its article, if it is not a regular file.
pub(crate) fn other_than_a_file(found: &fs::Metadata) -> Option<&'static str> {
    let kind = found.file_type();
    if kind.is_file() {
        return None;
    }
    if kind.is_dir() {
        return Some(FOLDER);
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return Some("a pipe");
        }
        if kind.is_socket() {
            return Some("a socket");
        }
        if kind.is_block_device() || kind.is_char_device() {
            return Some("a device");
        }
    }
    Some("no regular file")
}

/// A name in a folder.
pub struct Entry {
    /// The name.
    pub name: OsString,
    /// True for a folder; false for a link to one.
    pub is_dir: bool,
}

/// Returns the names in `folder`, in no fixed order.
pub fn entries(folder: &Path) -> io::Result<Box<dyn Iterator<Item = io::Result<Entry>>>> {
    if !is_in_memory(folder) {
        let entries = fs::read_dir(folder)?;
        return Ok(Box::new(entries.map(|entry| {
            let entry = entry?;
            Ok(Entry {
                is_dir: entry.file_type()?.is_dir(),
                name: entry.file_name(),
            })
        })));
    }
    let folder = plain(folder);
    let memory = MEMORY.read().unwrap_or_else(PoisonError::into_inner);
    let names: BTreeMap<OsString, bool> = memory
        .files
        .keys()
        .filter_map(|file| file.strip_prefix(&folder).ok())
        .filter_map(|file| {
            let mut parts = file.components();
            Some((parts.next()?.as_os_str().to_owned(), parts.next().is_some()))
        })
        .collect();
    let entries = names.into_iter().map(|(name, is_dir)| Ok(Entry { name, is_dir }));
    Ok(Box::new(entries))
}

/// Creates the folder at `path`, whose parent is there.
pub fn create_dir(path: &Path) -> io::Result<()> {
    if is_in_memory(path) {
        return Ok(());
    }
    fs::create_dir(path)
}

/// Writes the file at `path`.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if is_in_memory(path) {
        put(path, bytes);
        return Ok(());
    }
    fs::write(path, bytes)
}

/// A file that is read.
#[derive(Debug)]
pub enum Opened {
    /// A file of the disk.
    Disk(fs::File),
    /// A file in memory.
    Memory(Cursor<Bytes>),
}

/// Opens the file at `path`.
pub fn open(path: &Path) -> io::Result<Opened> {
    match place(path) {
        Place::Disk => fs::File::open(path).map(Opened::Disk),
        Place::Held(bytes) => Ok(Opened::Memory(Cursor::new(bytes))),
        Place::Folder | Place::Nothing => Err(absent()),
    }
}

impl Opened {
    /// Returns the size of the file, bytes.
    pub fn size(&self) -> io::Result<u64> {
        match self {
            Self::Disk(file) => file.metadata().map(|found| found.len()),
            Self::Memory(bytes) => Ok(bytes.get_ref().len() as u64),
        }
    }
}

impl Read for Opened {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Disk(file) => file.read(buffer),
            Self::Memory(bytes) => bytes.read(buffer),
        }
    }
}

impl Seek for Opened {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::Disk(file) => file.seek(to),
            Self::Memory(bytes) => bytes.seek(to),
        }
    }
}

/// A file that is written.
pub enum Written {
    /// A file of the disk.
    Disk(fs::File),
    /// A file in memory.
    Memory(Cursor<Vec<u8>>),
}

impl Written {
    /// Brings the file to the disk, if it is one of the disk.
    pub(crate) fn sync(&self) -> io::Result<()> {
        match self {
            Self::Disk(file) => file.sync_all(),
            Self::Memory(_) => Ok(()),
        }
    }
}

impl Write for Written {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Disk(file) => file.write(bytes),
            Self::Memory(held) => held.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Disk(file) => file.flush(),
            Self::Memory(_) => Ok(()),
        }
    }
}

impl Seek for Written {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::Disk(file) => file.seek(to),
            Self::Memory(held) => held.seek(to),
        }
    }
}
