//! Bounds that every library keeps, so that a validator's work and a player's memory are known in advance.

/// Largest order of a model: stages of its lattice.
pub const MAX_ORDER: usize = 400;

/// Size of a library slot in the stylus's flash, bytes (four 128 KiB sectors; `memory.x` holds the same figure).
pub const SLOT_BYTES: usize = 512 * 1024;

/// Flash word of the STM32H743, bytes: the smallest piece that can be programmed (RM0433 section 4.3.9).
pub const FLASH_WORD_BYTES: usize = 32;

/// Size of a slot's own header, bytes: a few flash words, written last.
pub const SLOT_HEADER_BYTES: usize = 256;

/// Largest library, bytes: it fits in a slot beside the header.
pub const MAX_LIBRARY_BYTES: usize = SLOT_BYTES - SLOT_HEADER_BYTES;

/// Most textures in a library. A scene's surface names its texture by an index of one byte.
pub const MAX_TEXTURES: usize = 256;

/// Most stages of a lattice, from the first, that may have a finer θ. A tail, see [`crate::Tail`], begins after them.
pub const MAX_FINE_STAGES: usize = 32;

/// Smallest magnitude of the largest code of a tail, see [`crate::Tail`], unless its step is 1 or 0: below it half the
/// step would do.
pub const MIN_LARGEST_TAIL_CODE: u8 = 64;

/// Most bytes of a texture's excitation, its codebooks and the byte of each node.
pub const MAX_EXCITATION_BYTES: usize = 16 * 1024;

/// Most codebooks of a texture.
pub const MAX_CODEBOOKS: usize = 4;

/// Fewest samples of a codebook: 0.2 s at 5 kHz.
pub const MIN_CODEBOOK_SAMPLES: usize = 1000;

/// Most samples of a codebook: those of as many blocks as there is room for.
pub const MAX_CODEBOOK_SAMPLES: usize = MAX_EXCITATION_BYTES / 25 * 64;

/// Shortest mean of a texture's moments, samples.
pub const MIN_MOMENT_SAMPLES: u16 = 250;

/// Longest mean of a texture's moments, samples: 1 s at 5 kHz. It bounds the density of what a codebook plays, see the
/// kernel's `lattice`.
pub const MAX_MOMENT_SAMPLES: u16 = 5000;

/// Highest peak of a codebook, standard deviations. A fed excitation has its full scale at 64.
pub const MAX_CODEBOOK_PEAK: f32 = 40.0;

/// Fewest and most samples from one entry of a level track to the next.
pub const MIN_MODULATION_STEP_SAMPLES: u32 = 25;

/// See [`MIN_MODULATION_STEP_SAMPLES`].
pub const MAX_MODULATION_STEP_SAMPLES: u32 = 500;

/// Fewest entries of a level track.
pub const MIN_MODULATION_ENTRIES: usize = 20;

/// Most entries of a level track.
pub const MAX_MODULATION_ENTRIES: usize = 4096;

/// Lowest mean square of a codebook and of a level track. The level of a node, and with it every limit on output, rests
/// on an excitation of variance 1.
pub const MIN_FED_POWER: f32 = 0.98;

/// Highest mean square of a codebook and of a level track; see [`MIN_FED_POWER`].
pub const MAX_FED_POWER: f32 = 1.02;

/// Most lines of a texture that are tied to position.
pub const MAX_LINES: usize = 8;

/// Shortest wavelength of a line, mm. A stroke of 44 mm/s takes it to 0.44 of a sample rate of 5 kHz.
pub const MIN_WAVELENGTH_MM: f32 = 0.02;

/// Longest wavelength of a line, mm.
pub const MAX_WAVELENGTH_MM: f32 = 1000.0;

/// Largest amplitude of a line, m/s²: an eighth of the output's full scale.
pub const MAX_LINE_AMPLITUDE: f32 = 256.0;

/// Most wanders of a texture's lines.
pub const MAX_WANDERS: usize = 4;

/// Shortest correlation length of a wander, mm.
pub const MIN_CORRELATION_MM: f32 = 0.05;

/// Longest correlation length of a wander, mm.
pub const MAX_CORRELATION_MM: f32 = 1000.0;

/// Largest RMS of a wander over its correlation length: the RMS share by which a line's frequency wanders.
pub const MAX_WANDER_SLOPE: f32 = 0.25;

/// Highest speed of a clock that moves the place of lines, mm/s.
pub const MAX_CLOCK_MM_S: f32 = 10_000.0;

/// Longest name of a texture, bytes of UTF-8.
pub const MAX_NAME_BYTES: usize = 48;

/// Most values on one axis of a grid.
pub const MAX_AXIS_LEN: usize = 64;

/// Highest sample rate of a texture, Hz.
pub const MAX_SAMPLE_RATE_HZ: u32 = 48_000;

/// Largest output power of a node, (m/s²)²: RMS of 256 m/s², an eighth of the output's full scale.
pub const MAX_OUTPUT_POWER: f32 = 65_536.0;

/// Most bytes of a checksum, or of nodes with their coefficients, that one step of [`crate::Decoder`] takes up. A step
/// ends with the node that reaches it.
pub const STEP_BYTES: usize = 2048;

/// Most instructions of decoding on a Cortex-M: this many, and the following per byte, texture and scene.
///
/// `tests/qemu/tests/emulated/bounds.rs` holds these bounds and those below, with extreme libraries.
pub const DECODE_INSTRUCTIONS: u64 = 5_000;

/// Most instructions of decoding per byte of the library; see [`DECODE_INSTRUCTIONS`].
pub const DECODE_INSTRUCTIONS_PER_BYTE: u64 = 40;

/// Most instructions of decoding per texture; see [`DECODE_INSTRUCTIONS`].
pub const DECODE_INSTRUCTIONS_PER_TEXTURE: u64 = 1_500;

/// Most instructions of decoding per scene; see [`DECODE_INSTRUCTIONS`]. All but 40 000 are for the gain of its
/// equaliser: 640 for each of 1025 intervals at most. Eight narrow sections at the limit take 151.
pub const DECODE_INSTRUCTIONS_PER_SCENE: u64 = 700_000;

/// Most instructions of one step of [`crate::Decoder`] on a Cortex-M.
pub const STEP_INSTRUCTIONS: u64 = 60_000;

/// Most instructions of a plan on a Cortex-M, from the name of a texture or scene to the check of its cost, whatever
/// the library.
pub const PLAN_INSTRUCTIONS: u64 = 300_000;
