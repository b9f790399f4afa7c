//! The use of each memory by an image, computed from its sections.

use std::fmt;

use object::read::elf::{ElfFile32, FileHeader, ProgramHeader};
use object::{Endianness, Object, ObjectSymbol, elf};

use anyhow::{Context, Result, bail};

/// A memory, and how many of its bytes are used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Use {
    /// The name.
    pub name: &'static str,
    /// The first address.
    pub start: u64,
    /// Number of used bytes.
    pub used: u64,
    /// Total number of bytes.
    pub size: u64,
}

/// All memories of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Memory(Vec<Use>);

/// The memory map that the linker reads.
const MAP: &str = include_str!("../../../../memory.x");

/// Name of each memory in tables, and its name in the map.
const SHOWN: [(&str, &str); 5] = [
    ("bootloader", "BOOTLOADER"),
    ("flash", "FLASH"),
    ("ITCM", "ITCM"),
    ("DTCM, data", "RAM"),
    ("DTCM, stack", "STACK"),
];

/// Largest use of a memory by the product's image and its bootloader, bytes. The rest is reserved for extensions.
const LIMITS: [(&str, u64); 3] = [("bootloader", 32 * 1024), ("flash", 340 * 1024), ("ITCM", 56 * 1024)];

/// Returns first address and length of the region called `name` in the map.
pub(super) fn region(name: &str) -> Option<(u64, u64)> {
    let line = MAP.lines().find(|line| line.split_whitespace().next() == Some(name))?;
    let (start, rest) = line.split_once("ORIGIN = 0x")?.1.split_once(", LENGTH = ")?;
    let kilobytes: u64 = rest.split_once('K')?.0.parse().ok()?;
    Some((u64::from_str_radix(start, 16).ok()?, kilobytes * 1024))
}

impl Memory {
    /// Reads the use of memories from the bytes of an image.
    pub fn of(image: &[u8]) -> Result<Self> {
        let file = ElfFile32::<Endianness>::parse(image)?;
        let mut uses = Vec::new();
        for (name, in_map) in SHOWN {
            let missing = || format!("memory.x has no region {in_map}");
            let (start, size) = region(in_map).with_context(missing)?;
            uses.push(Use {
                name,
                start,
                used: 0,
                size,
            });
        }
        let endian = file.endian();
        let segments = file.elf_header().program_headers(endian, file.data());
        for segment in segments? {
            if segment.p_type(endian) != elf::PT_LOAD {
                continue;
            }
            let (at, kept) = (u64::from(segment.p_vaddr(endian)), u64::from(segment.p_paddr(endian)));
            let (in_memory, in_file) = (u64::from(segment.p_memsz(endian)), u64::from(segment.p_filesz(endian)));
            add(&mut uses, at, in_memory);
            // Data that is copied at the start also occupies flash.
            if kept != at {
                add(&mut uses, kept, in_file);
            }
        }
        let symbol = |name| {
            file.symbols()
                .find(|symbol| symbol.name() == Ok(name))
                .map(|symbol| symbol.address())
        };
        // The stack has no segment, only these two symbols of the linker script.
        if let (Some(top), Some(bottom)) = (symbol("_stack_start"), symbol("_stack_end")) {
            add(&mut uses, bottom, top - bottom);
        }
        Ok(Self(uses))
    }

    /// Checks that the image leaves the required free space.
    pub fn check_limits(&self) -> Result<()> {
        for Use { name, used, .. } in &self.0 {
            let limit = LIMITS.iter().find(|(limited, _)| limited == name);
            if let Some(&(_, limit)) = limit.filter(|&&(_, limit)| *used > limit) {
                bail!("the image takes {used} bytes of {name}, and may take {limit}");
            }
        }
        Ok(())
    }

    /// All memories.
    pub fn uses(&self) -> &[Use] {
        &self.0
    }
}

fn add(uses: &mut [Use], address: u64, bytes: u64) {
    for place in uses {
        if (place.start..place.start + place.size).contains(&address) {
            place.used += bytes;
        }
    }
}

impl fmt::Display for Memory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<12} {:>9} {:>9} {:>6}", "memory", "used", "of bytes", "share")?;
        for Use { name, used, size, .. } in &self.0 {
            let share = *used as f64 * 100.0 / *size as f64;
            writeln!(f, "{name:<12} {used:>9} {size:>9} {share:>5.1}%")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_memory_that_is_shown_is_in_the_map() {
        for (_, name) in SHOWN {
            assert!(region(name).is_some_and(|(_, size)| size > 0), "{name}");
        }
        assert_eq!(region("FLASH").map(|(start, _)| start), Some(0x0802_0000));
        assert_eq!(region("NOTHING"), None);
    }

    #[test]
    fn an_image_that_takes_more_than_a_limit_is_refused_with_the_memory() {
        for (name, limit) in LIMITS {
            let image = |used| {
                let (start, size) = (0, 1 << 20);
                Memory(vec![Use {
                    name,
                    start,
                    used,
                    size,
                }])
            };
            assert!(image(limit).check_limits().is_ok());
            let error = image(limit + 1).check_limits().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
            assert!(SHOWN.iter().any(|(shown, _)| *shown == name), "{name}");
        }
    }

    #[test]
    fn what_is_no_image_is_refused() {
        assert!(Memory::of(b"no image").is_err());
    }
}
