//! Faults that decoding and encoding a library report, each with its place.
//!
//! [`Library::decode`](crate::Library::decode) and `encode` make them; `stylus` shows them as they are. No allocation,
//! and no text but `'static` text, because the device makes them too. The package's README explains the fields and
//! their limits.

use core::fmt;

use crate::decimal::Decimal;
use crate::limits;
use crate::scene::SceneError;
use crate::scene::limits::MAX_SCENES;
use crate::wire::FORMAT_VERSION;

/// The first fault found in bytes that are no valid library, or in what was to be encoded.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct DecodeError {
    /// Place of the fault.
    pub place: Place,
    /// The fault.
    pub problem: Problem,
}

/// A place in a library. Textures, nodes, axis values and scenes are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The library as a whole: its prefix, its counts, and bytes after the last scene.
    Library,
    /// A texture.
    Texture(usize),
    /// A texture's speed axis.
    SpeedAxis(usize),
    /// A texture's force axis.
    ForceAxis(usize),
    /// A node of a texture's grid.
    Node {
        /// The texture.
        texture: usize,
        /// Index on the speed axis.
        speed: usize,
        /// Index on the force axis.
        force: usize,
    },
    /// A scene.
    Scene(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Library => f.write_str("library"),
            Self::Texture(texture) => write!(f, "texture {texture}"),
            Self::SpeedAxis(texture) => write!(f, "texture {texture}, speed axis"),
            Self::ForceAxis(texture) => write!(f, "texture {texture}, force axis"),
            Self::Node {
                texture,
                speed,
                force,
            } => write!(f, "texture {texture}, node (speed {speed}, force {force})"),
            Self::Scene(scene) => write!(f, "scene {scene}"),
        }
    }
}

/// A fault of a library.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The first bytes are not those of a library.
    #[error("not a texture library (its first bytes are not \"HTXL\")")]
    NotALibrary,
    /// A format version that this program does not read.
    #[error(
        "format version {found}, and this program reads version {FORMAT_VERSION}: {}",
        if *found > FORMAT_VERSION { "the program is older than the file, update the program" }
        else { "the file is older than the program, fit it again" }
    )]
    Version {
        /// The version in the file.
        found: u16,
    },
    /// Fewer or more bytes than the prefix declares.
    #[error(
        "{found} bytes where the library declares {declared}: truncated, or followed by something else"
    )]
    Length {
        /// Length that the prefix declares, bytes.
        declared: u32,
        /// Length of the bytes.
        found: usize,
    },
    /// Fewer bytes than a prefix and a texture count take.
    #[error("{found} bytes are too few for a library")]
    TooShort {
        /// Length of the bytes.
        found: usize,
    },
    /// More bytes than a slot holds.
    #[error(
        "{found} bytes are more than the {} that a slot holds",
        limits::MAX_LIBRARY_BYTES
    )]
    TooLarge {
        /// Length of the bytes.
        found: usize,
    },
    /// A stored checksum that is not the bytes' own.
    #[error("checksum {computed:08x} where {stored:08x} is stored: the bytes were damaged")]
    Checksum {
        /// CRC-32 in the prefix.
        stored: u32,
        /// CRC-32 of the bytes.
        computed: u32,
    },
    /// A reserved field that is not zero.
    #[error("a reserved field is not zero")]
    Reserved,
    /// A texture's header that does not parse.
    #[error("the header does not parse")]
    Malformed,
    /// Optional parts that do not parse.
    #[error("its optional parts do not parse")]
    MalformedParts,
    /// An optional part of a kind that this program does not know.
    #[error(
        "an optional part of kind {0}, which this program does not know: a newer tool wrote it, update the program"
    )]
    UnknownPart(u32),
    /// An optional part that does not follow one of a lower kind.
    #[error("the optional part of kind {kind} comes twice, or after one of a higher kind")]
    PartOrder {
        /// Kind of the part.
        kind: u32,
    },
    /// Laws of the level that are not two bytes.
    #[error("the laws of the level take {0} bytes; there must be 2")]
    LevelsLength(usize),
    /// A law that this program does not know.
    #[error("the {what} law has the code {code}, which this program does not know: update it")]
    UnknownLaw {
        /// Name of the law: "level" or "fade".
        what: &'static str,
        /// The stored code.
        code: u8,
    },
    /// Laws that hold without being stated.
    #[error("the part with the laws of the level states those that hold without it")]
    DefaultLaws,
    /// A silent node of a texture whose levels are averaged in dB.
    #[error(
        "a silent node has no level in dB: give the texture the level law of power or amplitude, or leave speed 0 and \
         force 0 out of its grid"
    )]
    SilentInLogarithm,
    /// Fractions of θ that are not the same number of bytes for each node, or too many.
    #[error(
        "{found} bytes of fractions of θ for {nodes} nodes; there must be 1 to {max} for each",
        max = limits::MAX_FINE_STAGES
    )]
    FineLength {
        /// Length of the part, bytes.
        found: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// Fractions for too many stages; their number. Only encoding can meet it.
    #[error("fractions of θ for {0} stages; there may be {max}", max = limits::MAX_FINE_STAGES)]
    FineStages(usize),
    /// A fraction for a stage that the node's model does not have.
    #[error("a fraction of θ for stage {stage} of a model of order {order}")]
    FineBeyondOrder {
        /// Number of the stage, from 1.
        stage: usize,
        /// Order of the model.
        order: usize,
    },
    /// A last fine stage in which all fractions are 0, so that the part could be shorter or missing.
    #[error("all fractions of θ of the last fine stage, {stage}, are 0")]
    FineStageUnused {
        /// Number of the stage, from 1.
        stage: usize,
    },
    /// More or fewer bytes of steps of tails than two for each node.
    #[error("{found} bytes of steps of tails; each of the {nodes} nodes must have two")]
    TailSteps {
        /// Length of the part, bytes.
        found: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// Tails in a texture whose nodes have too few stages for one.
    #[error(
        "no node has more than {max} stages, and so none has a tail: leave the part out",
        max = limits::MAX_FINE_STAGES
    )]
    NoTail,
    /// A code that is lower than the lowest of a tail.
    #[error("stage {stage} has the code -128 in a tail; codes are -127 to 127")]
    TailCode {
        /// Number of the stage, from 1.
        stage: usize,
    },
    /// A step of a tail that its codes do not need, or that is missing.
    #[error(
        "a tail of step {step} whose largest code is {largest}; the step must be 0 exactly where all codes are, and \
         at most 1 where the largest is below {min}",
        min = limits::MIN_LARGEST_TAIL_CODE
    )]
    TailStep {
        /// The step, in steps of [`crate::FINE_THETA_STEP_RAD`].
        step: u16,
        /// Largest magnitude of the codes.
        largest: u8,
    },
    /// A tail that begins elsewhere than in the other nodes. Only encoding can meet it.
    #[error(
        "{before} stages of 16 bits and {after} in a tail; a tail begins after stage {max}, and if one node has one, \
         so has every node of more stages",
        max = limits::MAX_FINE_STAGES
    )]
    TailBegin {
        /// Number of stages with codes of 16 bits.
        before: usize,
        /// Number of stages in the tail.
        after: usize,
    },
    /// An excitation that does not parse.
    #[error("its excitation ends within a codebook: the bytes were damaged")]
    MalformedExcitation,
    /// An excitation that takes too many bytes; their number.
    #[error(
        "its excitation takes {0} bytes; there may be {max}: fit it with shorter or fewer codebooks",
        max = limits::MAX_EXCITATION_BYTES
    )]
    ExcitationBytes(usize),
    /// An excitation without codebooks, or with too many; their number.
    #[error(
        "{0} codebooks; there must be 1 to {max}, and a texture with a Gaussian excitation has no such part",
        max = limits::MAX_CODEBOOKS
    )]
    CodebookCount(usize),
    /// A codebook that is too short.
    #[error(
        "codebook {number} has {length} samples; there must be at least {min}: fit from a longer recording",
        min = limits::MIN_CODEBOOK_SAMPLES
    )]
    CodebookLength {
        /// Number of the codebook, from 1.
        number: usize,
        /// Its samples.
        length: usize,
    },
    /// A codebook's peak that is not positive, or too high.
    #[error(
        "codebook {number} has a peak of {peak} standard deviations; it must be above 0 and at most {max}: cut its \
         peaks",
        peak = Decimal(*.peak),
        max = Decimal(limits::MAX_CODEBOOK_PEAK)
    )]
    CodebookPeak {
        /// Number of the codebook, from 1.
        number: usize,
        /// The peak, standard deviations.
        peak: f32,
    },
    /// A code that the mu-law does not have.
    #[error("sample {sample} of codebook {number} is -128; codes are -127 to 127")]
    CodebookCode {
        /// Number of the codebook, from 1.
        number: usize,
        /// Index of the sample.
        sample: usize,
    },
    /// A codebook whose mean square is not 1.
    #[error(
        "codebook {number} has a mean square of {power}; it must be {min} to {max}, so that the level is that of the \
         nodes: scale its peak",
        power = Decimal(*.power),
        min = Decimal(limits::MIN_FED_POWER),
        max = Decimal(limits::MAX_FED_POWER)
    )]
    CodebookPower {
        /// Number of the codebook, from 1.
        number: usize,
        /// Its mean square.
        power: f32,
    },
    /// More or fewer sources of excitation than nodes.
    #[error("{found} bytes with the codebooks of nodes where the axes span {nodes}")]
    CodebooksOfNodes {
        /// Number of the bytes.
        found: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// A node with a codebook that is not there.
    #[error("it has codebook {codebook}, and the texture has {count}")]
    UnknownCodebook {
        /// Number of the codebook, from 1.
        codebook: usize,
        /// Number of the texture's codebooks.
        count: usize,
    },
    /// A codebook that no node has; its number, from 1.
    #[error("no node has codebook {0}: leave it out")]
    UnusedCodebook(usize),
    /// A level track that does not parse.
    #[error("its level track does not parse: the bytes were damaged")]
    MalformedModulation,
    /// A distance of entries that is too small or too large, samples.
    #[error(
        "{0} samples from one entry of the level track to the next; there must be {min} to {max}",
        min = limits::MIN_MODULATION_STEP_SAMPLES,
        max = limits::MAX_MODULATION_STEP_SAMPLES
    )]
    ModulationStep(u32),
    /// Too few or too many entries; their number.
    #[error(
        "{0} entries of the level track; there must be {min} to {max}",
        min = limits::MIN_MODULATION_ENTRIES,
        max = limits::MAX_MODULATION_ENTRIES
    )]
    ModulationLength(usize),
    /// A level track whose mean square is not 1.
    #[error(
        "the level track has a mean square of {power} as it is played; it must be {min} to {max}, so that the level is \
         that of the nodes: shift its entries",
        power = Decimal(*.0),
        min = Decimal(limits::MIN_FED_POWER),
        max = Decimal(limits::MAX_FED_POWER)
    )]
    ModulationPower(f32),
    /// A level track that says what holds without it.
    #[error("all entries of the level track are 0 dB: leave it out")]
    FlatModulation,
    /// No line in the part that holds them, or too many; their number.
    #[error(
        "{0} lines that are locked to place; there must be 1 to {max}, and a texture without lines has no such part",
        max = limits::MAX_LINES
    )]
    LineCount(usize),
    /// Lines of more or fewer bytes than their number and the nodes take.
    #[error("{found} bytes of lines where their number and the nodes take {expected}")]
    LinesLength {
        /// Length of the part, bytes.
        found: usize,
        /// Length that its lines take, bytes.
        expected: usize,
    },
    /// A line of more or fewer amplitudes than nodes. Only encoding can meet it.
    #[error("line {line} has {found} amplitudes for {expected} nodes; there must be one for each")]
    LineNodes {
        /// Index of the line.
        line: usize,
        /// Number of its amplitudes.
        found: usize,
        /// Number of nodes.
        expected: usize,
    },
    /// A wavelength out of range, or none.
    #[error(
        "line {line} has a wavelength of {value} mm; it must be {min} to {max} mm",
        value = Decimal(*.value),
        min = Decimal(limits::MIN_WAVELENGTH_MM),
        max = Decimal(limits::MAX_WAVELENGTH_MM)
    )]
    Wavelength {
        /// Index of the line.
        line: usize,
        /// The wavelength, mm.
        value: f32,
    },
    /// A line with the wavelength of an earlier one.
    #[error("line {line} has the wavelength of line {other}: make one line of both")]
    WavelengthTaken {
        /// Index of the line.
        line: usize,
        /// Index of the earlier one.
        other: usize,
    },
    /// An amplitude of a line that is negative, too large or not finite.
    #[error(
        "line {line} has an amplitude of {value} m/s²; it must be finite, not negative and at most {max}",
        value = Decimal(*.value),
        max = Decimal(limits::MAX_LINE_AMPLITUDE)
    )]
    LineAmplitude {
        /// Index of the line.
        line: usize,
        /// The amplitude, m/s².
        value: f32,
    },
    /// A line that sounds at rest or out of contact; its index.
    #[error("line {0} must have an amplitude of 0 at a node of speed 0 or force 0")]
    LineAtZero(usize),
    /// A line whose amplitude is 0 at all nodes; its index.
    #[error("line {0} has an amplitude of 0 at all nodes: leave it out")]
    SilentLine(usize),
    /// Bytes after a texture's optional parts, within its string; their number.
    #[error("{0} bytes are left over after its optional parts")]
    LeftOverOfTexture(usize),
    /// A highest order that is not the nodes' own.
    #[error("it states a highest order of {stored}, and the nodes' is {found}")]
    HighestOrder {
        /// The stored order.
        stored: u16,
        /// Highest order of the nodes.
        found: u16,
    },
    /// A highest output power that is not the nodes' own.
    #[error(
        "it states a highest output power of {stored} (m/s²)², and the nodes' is {found}",
        stored = Decimal(*.stored),
        found = Decimal(*.found)
    )]
    HighestPower {
        /// The stored power, (m/s²)².
        stored: f32,
        /// Highest output power of the nodes, (m/s²)².
        found: f32,
    },
    /// Bytes after the last scene; their number.
    #[error("{0} bytes are left over after the last scene")]
    LeftOver(usize),
    /// No texture, or too many; their number.
    #[error("{0} textures; there must be 1 to {max}", max = limits::MAX_TEXTURES)]
    TextureCount(usize),
    /// Bytes that end before the number of scenes.
    #[error("it ends before the number of its scenes")]
    NoSceneCount,
    /// Too many scenes; their number.
    #[error("{0} scenes; there must be at most {MAX_SCENES}")]
    SceneCount(usize),
    /// A record that is no scene, or more than one.
    #[error("its record does not parse as a scene")]
    MalformedScene,
    /// A scene with the name of an earlier one; that one's index.
    #[error("the same name as scene {0}")]
    SceneNameTaken(usize),
    /// A scene that cannot be played.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A name that is empty or too long; its length in bytes.
    #[error("a name of {0} bytes; there must be 1 to {max}", max = limits::MAX_NAME_BYTES)]
    NameLength(usize),
    /// A name with characters that cannot be typed or shown.
    #[error("a name with a control character")]
    NameCharacter,
    /// A texture with the name of an earlier one; that one's index.
    #[error("the same name as texture {0}")]
    NameTaken(usize),
    /// A sample rate of zero, or too high, Hz.
    #[error("a sample rate of {0} Hz; there must be 1 to {max}", max = limits::MAX_SAMPLE_RATE_HZ)]
    SampleRate(u32),
    /// An axis without values, or with too many; their number.
    #[error("{0} values; there must be 1 to {max}", max = limits::MAX_AXIS_LEN)]
    AxisLength(usize),
    /// A byte string whose length is no multiple of its records' length.
    #[error("{found} bytes are no whole number of records of {record} bytes")]
    Ragged {
        /// Length of the string, bytes.
        found: usize,
        /// Length of one record, bytes.
        record: usize,
    },
    /// A value on an axis that is negative or not finite.
    #[error("value {index} is {value}; it must be finite and not negative", value = Decimal(*.value))]
    AxisValue {
        /// Index of the value.
        index: usize,
        /// The value.
        value: f32,
    },
    /// Values on an axis that do not ascend.
    #[error("value {index} is not greater than the one before; the axis must ascend")]
    AxisOrder {
        /// Index of the value.
        index: usize,
    },
    /// More or fewer nodes than the axes span.
    #[error("{found} nodes where the axes span {expected}")]
    NodeCount {
        /// Number of nodes.
        found: usize,
        /// Number of nodes that the axes span.
        expected: usize,
    },
    /// An order above the limit.
    #[error("order {0}; the highest is {max}", max = limits::MAX_ORDER)]
    Order(usize),
    /// Flags that this version does not know, all of the byte.
    #[error("unknown flags {0:#04x}")]
    Flags(u16),
    /// A power that is negative, too large or not finite.
    #[error(
        "{what} power is {value} (m/s²)²; it must be finite, not negative and at most {max}",
        value = Decimal(*.value),
        max = Decimal(limits::MAX_OUTPUT_POWER)
    )]
    Power {
        /// Name of the power: "output" or "prediction error".
        what: &'static str,
        /// The power, (m/s²)².
        value: f32,
    },
    /// A prediction error that is stronger than the output that it drives.
    #[error("the prediction error's power is above the output's")]
    PowerOrder,
    /// A silent flag that disagrees with the output power.
    #[error("the silent flag is set exactly where the output power is zero; here they disagree")]
    SilentFlag,
    /// A node at rest or out of contact that is not silent.
    #[error("a node at speed 0 or force 0 must be silent")]
    NotSilentAtZero,
    /// Coefficients that do not lie one node after the other.
    #[error("coefficients begin at byte {found} where {expected} is due")]
    Offset {
        /// Byte at which they begin.
        found: u32,
        /// Byte at which those of the node before end.
        expected: usize,
    },
    /// More or fewer coefficient bytes than the nodes use.
    #[error("{found} bytes of coefficients where the nodes use {expected}")]
    CoefficientLength {
        /// Length of the texture's coefficients, bytes.
        found: usize,
        /// Length that the nodes use, bytes.
        expected: usize,
    },
    /// A reflection coefficient of magnitude one, whose stage would never decay.
    #[error("stage {stage} has a reflection coefficient of magnitude 1")]
    ReflectionCoefficient {
        /// Number of the stage, from 1.
        stage: usize,
    },
}

impl Problem {
    pub(crate) const fn at(self, place: Place) -> DecodeError {
        DecodeError {
            place,
            problem: self,
        }
    }
}
