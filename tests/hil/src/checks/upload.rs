//! An upload: the library is listed afterwards and can be activated.

use model_format::link::LIBRARY_CRC;
use stylus_link::link::upload::upload;

use crate::bench::DeviceUnderTest;
use crate::error::Result;

/// Uploads `library` and activates it.
pub fn check(bench: &mut DeviceUnderTest, library: &[u8]) -> Result<()> {
    let active = bench.status()?.library_crc32;
    let crc32 = LIBRARY_CRC.checksum(library);
    let begin = bench.status()?;
    let uploaded = upload(&mut bench.device, library, |_| ())?;
    let end = bench.status()?;
    bench.judge(
        "a library is uploaded and read back",
        format!(
            "{} bytes and {} textures in slot {}, {} ms",
            uploaded.library.length,
            uploaded.textures.len(),
            uploaded.slot,
            end.uptime_ms.saturating_sub(begin.uptime_ms)
        ),
        "same length and checksum, every texture listed",
        (uploaded.library.length as usize, uploaded.library.crc32) == (library.len(), crc32),
    );
    bench.judge(
        "an upload leaves the active library alone",
        format!("{:08x}", end.library_crc32),
        format!("{active:08x}"),
        end.library_crc32 == active,
    );
    let scenes = bench.device.scenes(uploaded.slot)?.len();
    bench.judge(
        "every scene is listed",
        scenes.to_string(),
        uploaded.library.scenes.to_string(),
        scenes == usize::from(uploaded.library.scenes),
    );
    let activated = bench.device.activate(uploaded.slot)?;
    let status = bench.status()?;
    bench.judge(
        "the library is activated",
        format!("slot {}, {:08x}", activated.slot, status.library_crc32),
        format!("slot {}, {crc32:08x}", uploaded.slot),
        activated.slot == uploaded.slot && status.library_crc32 == crc32,
    );
    Ok(())
}
