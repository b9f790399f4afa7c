//! Bounds that every library keeps, so that a validator's work and a player's memory are known in advance.

/// Largest order of a model, which is the number of its lattice's stages.
pub const MAX_ORDER: usize = 400;

/// Size of a library slot in the stylus's flash, bytes (four 128 KiB sectors; `memory.x` holds the same figure).
pub const SLOT_BYTES: usize = 512 * 1024;

/// Flash word of the STM32H743, bytes: the smallest piece that can be programmed (RM0433 section 4.3.9).
pub const FLASH_WORD_BYTES: usize = 32;

/// Size of a slot's own header, bytes: a few flash words, written last.
pub const SLOT_HEADER_BYTES: usize = 256;

/// Size of the largest library, bytes. It fills a slot together with the slot's header.
pub const MAX_LIBRARY_BYTES: usize = SLOT_BYTES - SLOT_HEADER_BYTES;

/// Largest number of textures in a library. A scene's surface names its texture by an index of one byte.
pub const MAX_TEXTURES: usize = 256;

/// Largest number of stages, counted from a lattice's first, whose θ may have more digits than a 16-bit code. A tail,
/// see [`crate::Tail`], begins after these stages.
pub const MAX_FINE_STAGES: usize = 32;

/// Smallest magnitude that the largest code of a tail may have; see [`crate::Tail`]. If the largest code were smaller,
/// half the step would suffice. The bound does not apply to steps of 0 and 1.
pub const MIN_LARGEST_TAIL_CODE: u8 = 64;

/// Largest size of a texture's excitation, bytes: its codebooks and one byte per node.
pub const MAX_EXCITATION_BYTES: usize = 16 * 1024;

/// Largest number of codebooks of a texture.
pub const MAX_CODEBOOKS: usize = 4;

/// Smallest number of samples of a codebook: 0.2 s at 5 kHz.
pub const MIN_CODEBOOK_SAMPLES: usize = 1000;

/// Largest number of samples of a codebook: 64 for each 25-byte block that fits in [`MAX_EXCITATION_BYTES`].
pub const MAX_CODEBOOK_SAMPLES: usize = MAX_EXCITATION_BYTES / 25 * 64;

/// Smallest mean length of a texture's moments (recorded snippets), samples.
pub const MIN_MOMENT_SAMPLES: u16 = 250;

/// Largest mean length of a texture's moments (recorded snippets), samples: 1 s at 5 kHz.
pub const MAX_MOMENT_SAMPLES: u16 = 5000;

/// Highest peak of a codebook, standard deviations. The full scale of a fed excitation is 64 standard deviations.
pub const MAX_CODEBOOK_PEAK: f32 = 40.0;

/// Smallest number of samples from one entry of a level track to the next.
pub const MIN_MODULATION_STEP_SAMPLES: u32 = 25;

/// Largest number of samples from one entry of a level track to the next.
pub const MAX_MODULATION_STEP_SAMPLES: u32 = 500;

/// Smallest number of entries of a level track.
pub const MIN_MODULATION_ENTRIES: usize = 20;

/// Largest number of entries of a level track.
pub const MAX_MODULATION_ENTRIES: usize = 4096;

/// Lowest mean square of a codebook and of a level track. The level of a node, and with it every limit on the output,
/// assumes an excitation of variance 1.
pub const MIN_FED_POWER: f32 = 0.98;

/// Highest mean square of a codebook and of a level track; see [`MIN_FED_POWER`].
pub const MAX_FED_POWER: f32 = 1.02;

/// Largest number of lines of a texture.
pub const MAX_LINES: usize = 8;

/// Shortest wavelength of a line, mm. At a speed of 44 mm/s, such a line has a frequency of 0.44 of a sample rate of 5
/// kHz.
pub const MIN_WAVELENGTH_MM: f32 = 0.02;

/// Longest wavelength of a line, mm.
pub const MAX_WAVELENGTH_MM: f32 = 1000.0;

/// Largest amplitude of a line, m/s²: an eighth of the output's full scale.
pub const MAX_LINE_AMPLITUDE: f32 = 256.0;

/// Largest number of wanders of a texture's lines.
pub const MAX_WANDERS: usize = 4;

/// Shortest correlation length of a wander, mm.
pub const MIN_CORRELATION_MM: f32 = 0.05;

/// Longest correlation length of a wander, mm.
pub const MAX_CORRELATION_MM: f32 = 1000.0;

/// Largest ratio of a wander's RMS to its correlation length. This ratio is the RMS of the relative deviation of a
/// line's frequency.
pub const MAX_WANDER_SLOPE: f32 = 0.25;

/// Highest speed of a clock that moves the position of lines in place of the tool, mm/s.
pub const MAX_CLOCK_MM_S: f32 = 10_000.0;

/// Longest name of a texture, bytes of UTF-8.
pub const MAX_NAME_BYTES: usize = 48;

/// Largest number of values on one axis of a grid.
pub const MAX_AXIS_LEN: usize = 64;

/// Highest sample rate of a texture, Hz.
pub const MAX_SAMPLE_RATE_HZ: u32 = 48_000;

/// Largest output power of a node, (m/s²)²: RMS of 256 m/s², an eighth of the output's full scale.
pub const MAX_OUTPUT_POWER: f32 = 65_536.0;

/// Number of bytes that one step of [`crate::Decoder`] checks at most. A step that checks nodes with their coefficients
/// ends with the node that reaches this number.
pub const STEP_BYTES: usize = 2048;

/// Constant part of the largest number of instructions that decoding takes on a Cortex-M. The constants below add to it
/// per byte, texture and scene.
///
/// `tests/qemu/tests/emulated/bounds.rs` tests all bounds on instructions of this file, with extreme libraries.
pub const DECODE_INSTRUCTIONS: u64 = 5_000;

/// Largest number of instructions of decoding per byte of the library; see [`DECODE_INSTRUCTIONS`].
pub const DECODE_INSTRUCTIONS_PER_BYTE: u64 = 40;

/// Largest number of instructions of decoding per texture; see [`DECODE_INSTRUCTIONS`].
pub const DECODE_INSTRUCTIONS_PER_TEXTURE: u64 = 1_500;

/// Largest number of instructions of decoding per scene; see [`DECODE_INSTRUCTIONS`]. All but 40 000 are for the check
/// of the gain of the scene's equaliser: 640 for each interval of frequencies, of which there are 1025 at most. Eight
/// narrow sections at the limit take some 170 intervals.
pub const DECODE_INSTRUCTIONS_PER_SCENE: u64 = 700_000;

/// Largest number of instructions of one step of [`crate::Decoder`] on a Cortex-M.
pub const STEP_INSTRUCTIONS: u64 = 60_000;

/// Largest number of instructions of a plan on a Cortex-M for any library, from the name of a texture or scene to the
/// check of the plan's cost.
pub const PLAN_INSTRUCTIONS: u64 = 300_000;
