//! A second writer of the format, which checks nothing, and a checksum that is computed by its definition.

use model_format::{FORMAT_VERSION, NodeFlags, SAMPLE_RATE_HZ};

/// Length of the prefix, bytes.
pub const PREFIX_BYTES: usize = 16;

/// A library to be written, valid or invalid. `None` stands for the value that follows from the other fields.
#[derive(Clone, Debug)]
pub struct RawLibrary {
    pub magic: [u8; 4],
    pub version: u16,
    pub reserved: u16,
    pub total_bytes: Option<u32>,
    pub crc32: Option<u32>,
    pub count: Option<u32>,
    pub textures: Vec<RawTexture>,
    pub scene_count: Option<u8>,
    /// Records of scenes, without their lengths.
    pub scenes: Vec<Vec<u8>>,
    pub tail: Vec<u8>,
}

/// A texture to be written, with the content of its byte strings.
#[derive(Clone, Debug)]
pub struct RawTexture {
    pub name: Vec<u8>,
    pub sample_rate_hz: u32,
    pub provenance: u32,
    pub speed_axis: Vec<f32>,
    pub force_axis: Vec<f32>,
    pub nodes: Vec<RawNode>,
    pub coefficients: Vec<u8>,
    /// Highest order and output power in the texture's header; `None` stands for those of the nodes.
    pub summary: Option<(u32, f32)>,
    /// Kind and content of each optional part.
    pub parts: Vec<(u32, Vec<u8>)>,
    /// Number of parts that is written; `None` stands for the length of `parts`.
    pub part_count: Option<u32>,
    /// Bytes after the parts.
    pub tail: Vec<u8>,
    /// Surplus bytes after the records of a string, so that it holds no whole number of records.
    pub ragged: Ragged,
}

/// Numbers of surplus bytes, one for each byte string.
#[derive(Clone, Debug, Default)]
pub struct Ragged {
    pub speed_axis: usize,
    pub force_axis: usize,
    pub nodes: usize,
    pub coefficients: usize,
}

#[derive(Clone, Copy, Debug)]
pub struct RawNode {
    pub order: u16,
    pub flags: u16,
    pub output_power: f32,
    pub prediction_error_power: f32,
    pub offset: u32,
}

/// Content of a part with lines of these wavelengths, mm, and phases. It is for a grid of `nodes` nodes, of which the
/// first two are at speed 0 and have amplitudes of 0.
pub fn lines(lines: &[(f32, u16)], nodes: usize) -> Vec<u8> {
    let mut content = vec![lines.len() as u8];
    for (wavelength, phase) in lines {
        content.extend(wavelength.to_le_bytes());
        content.extend(phase.to_le_bytes());
        let amplitudes = (0..nodes).map(|node| if node < 2 { 0.0 } else { node as f32 / 4.0 });
        content.extend(amplitudes.flat_map(f32::to_le_bytes));
    }
    content
}

impl RawLibrary {
    /// A valid library of three small textures.
    ///
    /// Each has the speeds 0, 50 and 100 mm/s and the forces 0.5 and 1 N; the nodes at speed 0 are silent and of
    /// order 0, the others of order 2.
    pub fn sound() -> Self {
        Self {
            magic: *b"HTXL",
            version: FORMAT_VERSION,
            reserved: 0,
            total_bytes: None,
            crc32: None,
            count: None,
            textures: vec![
                RawTexture::sound("wool", &[-20_000, 5000]),
                RawTexture::sound("oak", &[20_000, -5000]),
                RawTexture::sound("tile", &[1 << 14, -(1 << 12)]),
            ],
            scene_count: None,
            scenes: Vec::new(),
            tail: Vec::new(),
        }
    }

    /// The library of [`RawLibrary::sound`] with every optional part, and two scenes: a plain scene, and one with
    /// everything that a scene may have.
    pub fn full() -> Self {
        let mut library = Self::sound();
        // Fractions of two stages for each node. The first two nodes have none.
        let fractions = [0, 0, 0, 0, 127, 0x80, 1, 0xff, 0, 3, 200, 0];
        library.textures[0].parts = vec![(1, vec![1, 1]), (2, fractions.to_vec())];
        library.textures[1].parts = vec![(1, vec![0, 1]), (3, two_codebooks(6))];
        let lines = lines(&[(0.61, 1), (1000.0, 65_535)], 6);
        library.textures[2].parts = vec![(3, two_codebooks(6)), (5, lines), (7, two_wanders())];
        library.textures.push(RawTexture::with_tails());
        library.scenes = vec![plain_scene(), full_scene()];
        library
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = self.magic.to_vec();
        bytes.extend(self.version.to_le_bytes());
        bytes.extend(self.reserved.to_le_bytes());
        bytes.extend([0; 8]);
        append_varint(self.count.unwrap_or(self.textures.len() as u32), &mut bytes);
        for texture in &self.textures {
            append_string(&texture.record(), &mut bytes);
        }
        bytes.push(self.scene_count.unwrap_or(self.scenes.len() as u8));
        for scene in &self.scenes {
            append_string(scene, &mut bytes);
        }
        bytes.extend(&self.tail);
        repair(&mut bytes);
        if let Some(total_bytes) = self.total_bytes {
            bytes[8..12].copy_from_slice(&total_bytes.to_le_bytes());
            repair_checksum(&mut bytes);
        }
        if let Some(crc32) = self.crc32 {
            bytes[12..16].copy_from_slice(&crc32.to_le_bytes());
        }
        bytes
    }
}

impl RawTexture {
    fn sound(name: &str, codes: &[i16]) -> Self {
        let coefficients: Vec<u8> = codes.iter().flat_map(|code| code.to_le_bytes()).collect();
        let silent = RawNode {
            order: 0,
            flags: NodeFlags::SILENT.bits().into(),
            output_power: 0.0,
            prediction_error_power: 0.0,
            offset: 0,
        };
        let moving = |index: usize| RawNode {
            order: 2,
            flags: NodeFlags::NONE.bits().into(),
            output_power: 4.0,
            prediction_error_power: 1.0,
            offset: (index * coefficients.len()) as u32,
        };
        let mut nodes = vec![silent; 2];
        nodes.extend((0..4).map(moving));
        Self {
            name: name.as_bytes().to_vec(),
            sample_rate_hz: SAMPLE_RATE_HZ,
            provenance: 1,
            speed_axis: vec![0.0, 50.0, 100.0],
            force_axis: vec![0.5, 1.0],
            nodes,
            coefficients: coefficients.repeat(4),
            summary: None,
            parts: Vec::new(),
            part_count: None,
            tail: Vec::new(),
            ragged: Ragged::default(),
        }
    }

    /// A texture with tails. Two nodes have order 0, one has order 32 and no tail, two have orders 33 and 37 and a
    /// tail, and one has a tail whose codes are all 0.
    pub fn with_tails() -> Self {
        let mut texture = Self::sound("felt", &[]);
        let mut steps = vec![0; 4];
        for (node, (tail, step)) in [
            (&[][..], 0u16),
            (&[0x81], 65_535),
            (&[63, 0xff, 0, 64, 0xc0], 300),
            (&[0, 0], 0),
        ]
        .into_iter()
        .enumerate()
        {
            let node = &mut texture.nodes[2 + node];
            node.offset = texture.coefficients.len() as u32;
            node.order = 32 + tail.len() as u16;
            let codes = (0..32).map(|stage: i16| (stage - 9) * 321);
            texture.coefficients.extend(codes.flat_map(i16::to_le_bytes));
            texture.coefficients.extend(tail);
            steps.extend(step.to_le_bytes());
        }
        let mut fractions = vec![0; 2];
        fractions.extend([0x80, 5, 127, 1]);
        texture.parts = vec![(2, fractions), (6, steps)];
        texture
    }

    /// The texture's record and its optional parts.
    fn record(&self) -> Vec<u8> {
        let bytes = &mut Vec::new();
        append_string(&self.name, bytes);
        append_varint(self.sample_rate_hz, bytes);
        append_varint(self.provenance, bytes);
        let mut strings: [Vec<u8>; 4] = [
            floats(&self.speed_axis),
            floats(&self.force_axis),
            self.nodes.iter().flat_map(RawNode::bytes).collect(),
            self.coefficients.clone(),
        ];
        let Ragged {
            speed_axis,
            force_axis,
            nodes,
            coefficients,
        } = self.ragged;
        let ragged = [speed_axis, force_axis, nodes, coefficients];
        for (string, ragged) in strings.iter_mut().zip(ragged) {
            string.resize(string.len() + ragged, 0);
            append_string(string, bytes);
        }
        let (order, power) = self.summary.unwrap_or_else(|| self.sound_summary());
        append_varint(order, bytes);
        append_f32(power, bytes);
        append_varint(self.part_count.unwrap_or(self.parts.len() as u32), bytes);
        for (kind, content) in &self.parts {
            append_varint(*kind, bytes);
            append_string(content, bytes);
        }
        bytes.extend(&self.tail);
        std::mem::take(bytes)
    }

    /// Highest order and output power of the nodes.
    pub fn sound_summary(&self) -> (u32, f32) {
        let order = self.nodes.iter().map(|node| u32::from(node.order)).max();
        let powers = self.nodes.iter().map(|node| node.output_power);
        (order.unwrap_or(0), powers.fold(0.0, f32::max))
    }
}

impl RawNode {
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = self.order.to_le_bytes().to_vec();
        bytes.extend(self.flags.to_le_bytes());
        bytes.extend(self.output_power.to_le_bytes());
        bytes.extend(self.prediction_error_power.to_le_bytes());
        bytes.extend(self.offset.to_le_bytes());
        bytes
    }
}

/// The content of a codebook of these blocks.
pub fn codebook(peak: f32, blocks: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    append_varint(blocks.len() as u32, &mut bytes);
    append_f32(peak, &mut bytes);
    bytes.extend(blocks);
    bytes
}

/// Blocks at these levels, whose samples all have the magnitude of the level and either sign in turn.
pub fn blocks(levels: impl IntoIterator<Item = i8>) -> Vec<u8> {
    let block = |level: i8| [[0xfb, 0xbe, 0xef].repeat(8), vec![level.cast_unsigned()]].concat();
    levels.into_iter().flat_map(block).collect()
}

/// The content of an excitation of two codebooks with a mean square of 1. The sources of the nodes are in turn Gaussian
/// noise, the first and the second codebook.
pub fn two_codebooks(nodes: usize) -> Vec<u8> {
    let mut bytes = vec![2];
    bytes.extend(codebook(1.0, &blocks([0; 16])));
    // Every other block is 12 dB down. So the mean square is 1 if the square of the peak is 2 / (1 + 10^-1.2).
    bytes.extend(codebook(1.3716, &blocks((0..18).map(|n| -24 * (n % 2)))));
    bytes.extend((0..nodes).map(|node| (node % 3) as u8));
    bytes
}

/// The content of two wanders of two lines: one of threads, and one at a clock.
fn two_wanders() -> Vec<u8> {
    let wanders = floats(&[0.1, 2.0, 0.0, 0.0, 1.0, 80.0]);
    [vec![2], wanders, vec![2, 1]].concat()
}

/// Appends seven bits per byte, the lowest first. The top bit is set if more bytes follow.
fn append_varint(mut value: u32, bytes: &mut Vec<u8>) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn append_f32(value: f32, bytes: &mut Vec<u8>) {
    bytes.extend(value.to_le_bytes());
}

/// Appends a zigzag varint: signs alternate, 0, -1, 1, -2 ...
fn append_signed(value: i32, bytes: &mut Vec<u8>) {
    append_varint(((value << 1) ^ (value >> 31)).cast_unsigned(), bytes);
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// The record of a scene of this name. `content` follows the sample rate.
fn scene(name: &str, content: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = Vec::new();
    append_string(name.as_bytes(), &mut bytes);
    append_varint(SAMPLE_RATE_HZ, &mut bytes);
    bytes.extend(content.concat());
    bytes
}

/// A scene of texture 0 everywhere.
fn plain_scene() -> Vec<u8> {
    // One surface: texture 0, gain 1, no tap, no stick-slip.
    let surface = [vec![1, 1, 0], floats(&[1.0]), vec![0, 0]].concat();
    // No region, no transition, a motion that is followed, no equaliser.
    scene("plain", &[surface, vec![0], floats(&[0.0]), vec![0, 0]])
}

/// A scene of two surfaces, one of them smooth, on two regions, at constant motion, through one section.
fn full_scene() -> Vec<u8> {
    let region = |start, end, surface| [floats(&[start, end]), vec![surface]].concat();
    let mut section = vec![1];
    for step in [1 << 28, -300_000_000, 100_000_000, -400_000_000, 200_000_000] {
        append_signed(step, &mut section);
    }
    let content = [
        [vec![2, 1, 2], floats(&[0.5])].concat(),
        [vec![1], floats(&[180.0, 0.01, 0.2, 30.0])].concat(),
        [vec![1], floats(&[1.5, 0.25, 0.75, 60.0, 0.5])].concat(),
        [vec![0], floats(&[1.0]), vec![0, 0]].concat(),
        [vec![2], region(-10.0, 20.0, 0), region(20.0, 50.0, 1)].concat(),
        floats(&[5.0]),
        [vec![1], floats(&[100.0, 0.75])].concat(),
        section,
    ];
    scene("full", &content)
}

fn append_string(string: &[u8], bytes: &mut Vec<u8>) {
    append_varint(string.len() as u32, bytes);
    bytes.extend(string);
}

/// Corrects the length and the checksum in `bytes`. Nothing changes if there are too few bytes for a prefix.
pub fn repair(bytes: &mut [u8]) {
    if bytes.len() >= PREFIX_BYTES {
        let total_bytes = bytes.len() as u32;
        bytes[8..12].copy_from_slice(&total_bytes.to_le_bytes());
        repair_checksum(bytes);
    }
}

fn repair_checksum(bytes: &mut [u8]) {
    let crc32 = checksum(bytes);
    bytes[12..16].copy_from_slice(&crc32.to_le_bytes());
}

/// The checksum that `bytes` should hold: it covers all bytes except the checksum itself.
pub fn checksum(bytes: &[u8]) -> u32 {
    crc32(bytes[..12].iter().chain(&bytes[16..]).copied())
}

/// CRC-32 by its definition: polynomial 0x04c11db7 reflected, ones at the start, inverted at the end.
fn crc32(bytes: impl Iterator<Item = u8>) -> u32 {
    let mut register = u32::MAX;
    for byte in bytes {
        register ^= u32::from(byte);
        for _ in 0..8 {
            let carry = register & 1;
            register = (register >> 1) ^ (0xedb8_8320 * carry);
        }
    }
    !register
}

#[test]
fn the_checksum_is_that_of_the_catalogue() {
    // Check value of CRC-32/ISO-HDLC in the RevEng catalogue of parametrised CRC algorithms.
    assert_eq!(crc32(b"123456789".iter().copied()), 0xcbf4_3926);
}
