//! The code and the functions of an image.

use object::read::elf::ElfFile32;
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SectionKind, SymbolKind};

use crate::error::{Error, Result};

/// The code of an image, as the linker left it.
#[derive(Clone, Debug)]
pub struct Image {
    /// The address and the bytes of each section of code.
    sections: Vec<(u32, Vec<u8>)>,
    /// The address, the size in bytes and the name of each function.
    functions: Vec<(u32, u32, String)>,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// The bytes are no ELF file.
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        let unreadable = |error: object::Error| Error::Image(error.to_string());
        let file = ElfFile32::<Endianness>::parse(bytes).map_err(unreadable)?;
        let mut sections = Vec::new();
        for section in file
            .sections()
            .filter(|section| section.kind() == SectionKind::Text)
        {
            let data = section.data().map_err(unreadable)?;
            sections.push((section.address() as u32, data.to_vec()));
        }
        let functions = file
            .symbols()
            .filter(|symbol| symbol.kind() == SymbolKind::Text && symbol.size() > 0)
            .map(|symbol| {
                // The lowest bit of a function's address marks Thumb code.
                let address = symbol.address() as u32 & !1;
                let name = symbol.name().unwrap_or_default().to_owned();
                (address, symbol.size() as u32, name)
            })
            .collect();
        Ok(Self {
            sections,
            functions,
        })
    }

    /// An image of code without names, for tests.
    #[cfg(test)]
    pub(crate) fn of_code(address: u32, code: Vec<u8>) -> Self {
        Self {
            sections: vec![(address, code)],
            functions: Vec::new(),
        }
    }

    /// The address of the one function whose mangled name contains `name`.
    ///
    /// # Errors
    /// No function or more than one has such a name.
    pub fn function(&self, name: &str) -> Result<u32> {
        let found: Vec<u32> = self
            .functions
            .iter()
            .filter(|(_, _, mangled)| mangled.contains(name))
            .map(|&(address, _, _)| address)
            .collect();
        match found[..] {
            [address] => Ok(address),
            _ => Err(Error::Function {
                name: name.to_owned(),
                found: found.len(),
            }),
        }
    }

    /// Up to four bytes of code from `address` on, which is the longest instruction.
    ///
    /// # Errors
    /// There is no code at the address.
    pub fn code(&self, address: u32) -> Result<&[u8]> {
        const LONGEST: usize = 4;
        let found = self.sections.iter().find_map(|(start, bytes)| {
            let offset = address.checked_sub(*start)? as usize;
            let rest = bytes.get(offset..)?;
            (rest.len() >= 2).then(|| &rest[..rest.len().min(LONGEST)])
        });
        found.ok_or(Error::NoCode(address))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_is_found_by_its_address_and_nothing_beyond_it() {
        let image = Image {
            sections: vec![(0x400, vec![1, 2, 3, 4, 5, 6])],
            functions: vec![
                (0x400, 4, "a6sampleE".into()),
                (0x404, 2, "a6updateE".into()),
            ],
        };
        assert_eq!(image.code(0x400).unwrap(), [1, 2, 3, 4]);
        assert_eq!(image.code(0x404).unwrap(), [5, 6]);
        for address in [0, 0x3fe, 0x406, u32::MAX] {
            assert!(matches!(image.code(address), Err(Error::NoCode(at)) if at == address));
        }
        assert_eq!(image.function("6update").unwrap(), 0x404);
        assert!(matches!(
            image.function("E"),
            Err(Error::Function { found: 2, .. })
        ));
        assert!(matches!(
            image.function("nothing"),
            Err(Error::Function { found: 0, .. })
        ));
    }

    #[test]
    fn what_is_no_image_is_refused() {
        assert!(Image::parse(b"no image").is_err());
    }
}
