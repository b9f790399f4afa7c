//! Reading a library: validation of any bytes, and views into those that hold.

use crate::error::{DecodeError, Place, Problem};
use crate::limits;
use crate::scene::Scene;
use crate::scene::limits::MAX_SCENES;
use crate::units::{MillimetresPerSecond, Newton};
use crate::wire::{
    self, CertificateRecord, NodeRecord, Prefix, Provenance, Structure, TextureRecord,
};

/// A validated texture library, borrowed from its bytes.
#[derive(Clone, Copy, Debug)]
pub struct Library<'a> {
    /// What follows the texture count.
    textures: &'a [u8],
    len: usize,
    /// What follows the scene count.
    scenes: &'a [u8],
    scene_count: usize,
}

/// A texture: models on a rectangular grid over (speed, force).
#[derive(Clone, Copy, Debug)]
pub struct Texture<'a> {
    name: &'a str,
    sample_rate_hz: u32,
    structure: Structure,
    provenance: Provenance,
    speed_axis: Axis<'a>,
    force_axis: Axis<'a>,
    nodes: &'a [u8],
    coefficients: &'a [u8],
    certificate: CertificateRecord<'a>,
}

/// What is certified of a texture's stability at every point of its grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Certificate<'a> {
    /// Nothing; only [`Library::decode_uncertified`] lets such a texture through.
    None,
    /// A normalised lattice is stable wherever all |θ| are below π/2, and so at every weighted mean of its nodes, under
    /// every change. The decoder has found this largest code itself.
    Lattice {
        /// Largest |θ| of all nodes, in steps of [`crate::THETA_STEP_RAD`]; below 2¹⁵.
        largest_theta_code: u16,
    },
    /// A direct form whose every cell a host found stable. The decoder has checked that this was said of these very
    /// axes, nodes and coefficients, and of every cell; it has not repeated the proof.
    DirectForm {
        /// A byte a cell, speed-major, as many as [`Texture::cell_counts`] spans: the |A| of every weighted mean of the
        /// cell's nodes is at least 2^(-byte / [`CELL_MARGIN_STEPS_PER_OCTAVE`]) on the whole unit circle.
        cell_margins: &'a [u8],
    },
}

/// Steps in which [`Certificate::DirectForm`] stores a cell's margin.
pub const CELL_MARGIN_STEPS_PER_OCTAVE: u8 = 4;

/// A cell's byte that says that nothing is certified of it.
pub const UNCERTIFIED_CELL: u8 = u8::MAX;

/// What a decoder asks of direct forms.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Demand {
    /// A certificate.
    Certificate,
    /// Nothing, but a certificate that is there must hold.
    Nothing,
}

/// Ascending values of a grid's axis, finite and not negative.
#[derive(Clone, Copy, Debug)]
pub struct Axis<'a>(&'a [u8]);

/// The model at one node of a grid.
#[derive(Clone, Copy, Debug)]
pub struct Node<'a> {
    /// Variance of what the model puts out, (m/s²)².
    pub output_power: f32,
    /// Variance σ² of the white excitation of a direct form, (m/s²)²: the power of the prediction error.
    pub prediction_error_power: f32,
    /// What is to be known about the node's origin.
    pub flags: NodeFlags,
    /// The model's coefficients; as many as its order.
    pub coefficients: Coefficients<'a>,
}

/// A node's coefficients as stored: little-endian, not aligned, as many as the model's order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coefficients<'a> {
    /// θ of stage 1 first, in steps of [`crate::THETA_STEP_RAD`].
    Lattice(&'a [[u8; 2]]),
    /// h₁ first; h = code · 2^(exponent - 15).
    Direct16 {
        /// Binary exponent of the whole node.
        exponent: u8,
        /// The codes.
        codes: &'a [[u8; 2]],
    },
    /// h₁ first; h = code · 2^(exponent - 31).
    Direct32 {
        /// Binary exponent of the whole node.
        exponent: u8,
        /// The codes.
        codes: &'a [[u8; 4]],
    },
}

/// What is to be known about a node beside its model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct NodeFlags(u8);

impl NodeFlags {
    /// Nothing remarkable: the model was fitted to a recording.
    pub const NONE: Self = Self(0);
    /// The node puts out nothing; its output power is zero.
    pub const SILENT: Self = Self(1);
    /// No recording: filled from measured nodes on both sides.
    pub const INTERPOLATED: Self = Self(2);
    /// No recording: taken over from the nearest measured nodes, beyond the last of them.
    pub const EXTRAPOLATED: Self = Self(4);
    /// Triage found fault with a recording behind this node.
    pub const DOUBTFUL: Self = Self(8);

    const KNOWN: u8 = 0b1111;

    /// Both sets of flags together.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether all of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The byte that is stored.
    pub const fn bits(self) -> u8 {
        self.0
    }

    const fn from_bits(bits: u8) -> Option<Self> {
        if bits & !Self::KNOWN == 0 {
            Some(Self(bits))
        } else {
            None
        }
    }
}

impl<'a> Library<'a> {
    /// Checks `bytes` from the first to the last and gives a view of them.
    ///
    /// The work is bounded by a constant for each byte; nothing is copied but one scene at a time.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn decode(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        Self::decode_demanding(bytes, Demand::Certificate)
    }

    /// As [`Library::decode`], but lets direct forms without a certificate through, which may be unstable between their
    /// nodes. For benches that look into just that; a stylus must not play what it gives.
    ///
    /// # Errors
    /// The first fault found, with its place.
    pub fn decode_uncertified(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        Self::decode_demanding(bytes, Demand::Nothing)
    }

    fn decode_demanding(bytes: &'a [u8], demand: Demand) -> Result<Self, DecodeError> {
        let at = |problem: Problem| problem.at(Place::Library);
        if !bytes.starts_with(&wire::MAGIC) {
            return Err(at(Problem::NotALibrary));
        }
        let found = bytes.len();
        let (prefix, body) = postcard::take_from_bytes::<Prefix>(bytes)
            .map_err(|_| at(Problem::TooShort { found }))?;
        if prefix.version != wire::FORMAT_VERSION {
            let found = prefix.version;
            return Err(at(Problem::Version { found }));
        }
        if prefix.total_bytes as usize != found {
            let declared = prefix.total_bytes;
            return Err(at(Problem::Length { declared, found }));
        }
        if found > limits::MAX_LIBRARY_BYTES {
            return Err(at(Problem::TooLarge { found }));
        }
        let (stored, computed) = (prefix.crc32, wire::checksum(bytes));
        if stored != computed {
            return Err(at(Problem::Checksum { stored, computed }));
        }
        if prefix.reserved != 0 {
            return Err(at(Problem::Reserved));
        }
        let Some((&count, textures)) = body.split_first() else {
            return Err(at(Problem::TooShort { found }));
        };
        let len = usize::from(count);
        if len == 0 || len > limits::MAX_TEXTURES {
            return Err(at(Problem::TextureCount(len)));
        }
        let mut library = Self {
            textures,
            len,
            scenes: &[],
            scene_count: 0,
        };
        let rest = library.validate_textures(demand)?;
        let Some((&count, scenes)) = rest.split_first() else {
            return Err(at(Problem::NoSceneCount));
        };
        (library.scenes, library.scene_count) = (scenes, usize::from(count));
        if library.scene_count > MAX_SCENES {
            return Err(at(Problem::SceneCount(library.scene_count)));
        }
        library.validate_scenes()?;
        Ok(library)
    }

    /// Checks the textures, and gives what follows them.
    fn validate_textures(&self, demand: Demand) -> Result<&'a [u8], DecodeError> {
        let mut rest = self.textures;
        for index in 0..self.len {
            let (texture, after) = Texture::take(rest, index)?;
            texture.validate(index)?;
            texture.validate_certificate(index, demand)?;
            let mut earlier = self.textures().take(index);
            if let Some(other) = earlier.position(|other| other.name == texture.name) {
                return Err(Problem::NameTaken(other).at(Place::Texture(index)));
            }
            rest = after;
        }
        Ok(rest)
    }

    fn validate_scenes(&self) -> Result<(), DecodeError> {
        let mut rest = self.scenes;
        for index in 0..self.scene_count {
            let here = |problem: Problem| problem.at(Place::Scene(index));
            let (scene, after) = take_scene(rest).ok_or(here(Problem::MalformedScene))?;
            scene.validate(self).map_err(|error| here(error.into()))?;
            let mut earlier = self.scenes().take(index);
            if let Some(other) = earlier.position(|other| other.name == scene.name) {
                return Err(here(Problem::SceneNameTaken(other)));
            }
            rest = after;
        }
        if rest.is_empty() {
            Ok(())
        } else {
            Err(Problem::LeftOver(rest.len()).at(Place::Library))
        }
    }

    /// How many textures there are, at least one.
    #[expect(clippy::len_without_is_empty, reason = "a library is never empty")]
    pub fn len(&self) -> usize {
        self.len
    }

    /// The textures, in the order of the file.
    pub fn textures(&self) -> impl Iterator<Item = Texture<'a>> + use<'a> {
        let mut rest = self.textures;
        // Texture headers were parsed during validation, so that parsing them again does not fail.
        (0..self.len).map_while(move |index| {
            let (texture, after) = Texture::take(rest, index).ok()?;
            rest = after;
            Some(texture)
        })
    }

    /// The texture of this name.
    pub fn texture(&self, name: &str) -> Option<Texture<'a>> {
        self.textures().find(|texture| texture.name == name)
    }

    /// How many scenes there are, which may be none.
    pub fn scene_count(&self) -> usize {
        self.scene_count
    }

    /// The scenes, in the order of the file.
    pub fn scenes(&self) -> impl Iterator<Item = Scene> + use<'a> {
        let mut rest = self.scenes;
        // They were parsed during validation, so that parsing them again does not fail.
        (0..self.scene_count).map_while(move |_| {
            let (scene, after) = take_scene(rest)?;
            rest = after;
            Some(scene)
        })
    }

    /// The scene of this name.
    pub fn scene(&self, name: &str) -> Option<Scene> {
        self.scenes().find(|scene| scene.name == name)
    }
}

/// Parses the scene that `bytes` begin with, and gives what follows it; nothing if its record is not exactly a scene.
fn take_scene(bytes: &[u8]) -> Option<(Scene, &[u8])> {
    let (record, after) = postcard::take_from_bytes::<&[u8]>(bytes).ok()?;
    let (scene, rest) = postcard::take_from_bytes::<Scene>(record).ok()?;
    rest.is_empty().then_some((scene, after))
}

impl<'a> Texture<'a> {
    /// Parses the header of texture `index`, and gives what follows it.
    fn take(bytes: &'a [u8], index: usize) -> Result<(Self, &'a [u8]), DecodeError> {
        let (record, rest) = postcard::take_from_bytes::<TextureRecord<'a>>(bytes)
            .map_err(|_| Problem::Malformed.at(Place::Texture(index)))?;
        let texture = Self {
            name: record.name,
            sample_rate_hz: record.sample_rate_hz,
            structure: record.structure,
            provenance: record.provenance,
            speed_axis: Axis(record.speed_axis),
            force_axis: Axis(record.force_axis),
            nodes: record.nodes,
            coefficients: record.coefficients,
            certificate: record.certificate,
        };
        Ok((texture, rest))
    }

    fn validate(&self, index: usize) -> Result<(), DecodeError> {
        let here = |problem: Problem| problem.at(Place::Texture(index));
        if self.name.is_empty() || self.name.len() > limits::MAX_NAME_BYTES {
            return Err(here(Problem::NameLength(self.name.len())));
        }
        if self.name.chars().any(char::is_control) {
            return Err(here(Problem::NameCharacter));
        }
        if self.sample_rate_hz == 0 || self.sample_rate_hz > limits::MAX_SAMPLE_RATE_HZ {
            return Err(here(Problem::SampleRate(self.sample_rate_hz)));
        }
        self.speed_axis.validate(Place::SpeedAxis(index))?;
        self.force_axis.validate(Place::ForceAxis(index))?;
        whole_records(self.nodes, NodeRecord::BYTES).map_err(here)?;
        let width = self.structure.coefficient_bytes();
        whole_records(self.coefficients, width).map_err(here)?;
        let (found, expected) = (
            self.nodes.len() / NodeRecord::BYTES,
            self.speed_axis.len() * self.force_axis.len(),
        );
        if found != expected {
            return Err(here(Problem::NodeCount { found, expected }));
        }
        let mut end = 0;
        for speed in 0..self.speed_axis.len() {
            for force in 0..self.force_axis.len() {
                let place = Place::Node {
                    texture: index,
                    speed,
                    force,
                };
                end = self
                    .validate_node(speed, force, end)
                    .map_err(|problem| problem.at(place))?;
            }
        }
        if end == self.coefficients.len() {
            Ok(())
        } else {
            Err(here(Problem::CoefficientLength {
                found: self.coefficients.len(),
                expected: end,
            }))
        }
    }

    /// Checks one node whose coefficients are due at byte `begin`, and tells where they end.
    fn validate_node(&self, speed: usize, force: usize, begin: usize) -> Result<usize, Problem> {
        let record = self.record(speed, force);
        let order = usize::from(record.order);
        if order > limits::MAX_ORDER {
            return Err(Problem::Order(order));
        }
        let Some(flags) = NodeFlags::from_bits(record.flags) else {
            return Err(Problem::Flags(record.flags));
        };
        for (what, value) in [
            ("output", record.output_power),
            ("prediction error", record.prediction_error_power),
        ] {
            // A NaN is in no range; -0.0 would be one more way to write silence.
            if !(0.0..=limits::MAX_OUTPUT_POWER).contains(&value) || value.is_sign_negative() {
                return Err(Problem::Power { what, value });
            }
        }
        if record.prediction_error_power > record.output_power {
            return Err(Problem::PowerOrder);
        }
        let silent = record.output_power.to_bits() == 0;
        if flags.contains(NodeFlags::SILENT) != silent {
            return Err(Problem::SilentFlag);
        }
        let at_zero = self.speed_axis.value(speed) <= 0.0 || self.force_axis.value(force) <= 0.0;
        if at_zero && !silent {
            return Err(Problem::NotSilentAtZero);
        }
        if record.offset as usize != begin {
            return Err(Problem::Offset {
                found: record.offset,
                expected: begin,
            });
        }
        let end = begin + order * self.structure.coefficient_bytes();
        if end > self.coefficients.len() {
            return Err(Problem::CoefficientLength {
                found: self.coefficients.len(),
                expected: end,
            });
        }
        let highest = match self.structure {
            Structure::NormalisedLattice => 0,
            Structure::DirectForm16 | Structure::DirectForm32 => limits::MAX_EXPONENT,
        };
        if record.exponent > highest {
            return Err(Problem::Exponent {
                exponent: record.exponent,
                structure: self.structure,
                highest,
            });
        }
        self.node(speed, force).coefficients.validate()?;
        Ok(end)
    }

    /// Checks the certificate against nodes that were found valid.
    fn validate_certificate(&self, index: usize, demand: Demand) -> Result<(), DecodeError> {
        let here = |problem: Problem| Err(problem.at(Place::Texture(index)));
        match (self.structure, self.certificate) {
            (
                Structure::NormalisedLattice,
                CertificateRecord::Lattice {
                    largest_theta_code: stored,
                },
            ) => {
                let found = self.largest_theta_code();
                if stored != found {
                    return here(Problem::CertifiedTheta { stored, found });
                }
            }
            (
                Structure::DirectForm16 | Structure::DirectForm32,
                CertificateRecord::DirectForm {
                    crc32: stored,
                    cell_margins,
                },
            ) => {
                let (speeds, forces) = self.cell_counts();
                let (found, expected) = (cell_margins.len(), speeds * forces);
                if found != expected {
                    return here(Problem::CertifiedCells { found, expected });
                }
                let computed = self.certificate_checksum(cell_margins);
                if stored != computed {
                    return here(Problem::CertificateChecksum { stored, computed });
                }
                if let Some(cell) = cell_margins.iter().position(|&m| m == UNCERTIFIED_CELL) {
                    let (speed, force) = (cell / forces, cell % forces);
                    return Err(Problem::UncertifiedCell.at(Place::Cell {
                        texture: index,
                        speed,
                        force,
                    }));
                }
            }
            (Structure::DirectForm16 | Structure::DirectForm32, CertificateRecord::None) => {
                if demand == Demand::Certificate {
                    return here(Problem::Uncertified(self.structure));
                }
            }
            _ => return here(Problem::CertificateKind(self.structure)),
        }
        Ok(())
    }

    fn certificate_checksum(&self, cell_margins: &[u8]) -> u32 {
        let (Axis(speeds), Axis(forces)) = (self.speed_axis, self.force_axis);
        wire::checksum_of_strings([speeds, forces, self.nodes, self.coefficients, cell_margins])
    }

    /// Largest |θ| of all nodes of a lattice, in stored steps; the nodes' codes lie one after the other.
    fn largest_theta_code(&self) -> u16 {
        let codes = self.coefficients.as_chunks().0.iter();
        codes.fold(0, |largest, &code| {
            largest.max(i16::from_le_bytes(code).unsigned_abs())
        })
    }

    /// Name, unique in its library.
    pub fn name(&self) -> &'a str {
        self.name
    }

    /// Samples a second at which the models hold.
    pub fn sample_rate_hz(&self) -> u32 {
        self.sample_rate_hz
    }

    /// What the coefficients are for.
    pub fn structure(&self) -> Structure {
        self.structure
    }

    /// Where the recordings came from.
    pub fn provenance(&self) -> Provenance {
        self.provenance
    }

    /// Tangential speeds of the grid, mm/s.
    pub fn speed_axis(&self) -> Axis<'a> {
        self.speed_axis
    }

    /// Normal forces of the grid, N.
    pub fn force_axis(&self) -> Axis<'a> {
        self.force_axis
    }

    /// Tangential speed at index `speed` of the grid, which must be on the axis.
    pub fn speed(&self, speed: usize) -> MillimetresPerSecond {
        MillimetresPerSecond(self.speed_axis.value(speed))
    }

    /// Normal force at index `force` of the grid, which must be on the axis.
    pub fn force(&self, force: usize) -> Newton {
        Newton(self.force_axis.value(force))
    }

    /// The model at (`speed`, `force`), both indices on their axes.
    pub fn node(&self, speed: usize, force: usize) -> Node<'a> {
        let record = self.record(speed, force);
        let begin = record.offset as usize;
        let length = usize::from(record.order) * self.structure.coefficient_bytes();
        let bytes = &self.coefficients[begin..begin + length];
        let exponent = record.exponent;
        Node {
            output_power: record.output_power,
            prediction_error_power: record.prediction_error_power,
            flags: NodeFlags(record.flags),
            coefficients: match self.structure {
                Structure::NormalisedLattice => Coefficients::Lattice(bytes.as_chunks().0),
                Structure::DirectForm16 => Coefficients::Direct16 {
                    exponent,
                    codes: bytes.as_chunks().0,
                },
                Structure::DirectForm32 => Coefficients::Direct32 {
                    exponent,
                    codes: bytes.as_chunks().0,
                },
            },
        }
    }

    /// All nodes, speed-major, as the file has them.
    pub fn nodes(&self) -> impl Iterator<Item = Node<'a>> + use<'a> {
        let texture = *self;
        let forces = texture.force_axis.len();
        let count = texture.speed_axis.len() * forces;
        (0..count).map(move |index| texture.node(index / forces, index % forces))
    }

    /// How many cells there are along the speed and the force axis, at least one each: what lies between neighbouring
    /// values of the axis, or the one value that there is.
    pub fn cell_counts(&self) -> (usize, usize) {
        let cells = |axis: Axis<'_>| (axis.len() - 1).max(1);
        (cells(self.speed_axis), cells(self.force_axis))
    }

    /// What is certified of the texture's stability.
    pub fn certificate(&self) -> Certificate<'a> {
        match self.certificate {
            CertificateRecord::None => Certificate::None,
            CertificateRecord::Lattice { largest_theta_code } => {
                Certificate::Lattice { largest_theta_code }
            }
            CertificateRecord::DirectForm { cell_margins, .. } => {
                Certificate::DirectForm { cell_margins }
            }
        }
    }

    /// The highest order of all nodes.
    pub fn max_order(&self) -> usize {
        let orders = self.nodes().map(|node| node.coefficients.order());
        orders.max().unwrap_or(0)
    }

    /// The highest output power of all nodes, (m/s²)².
    pub fn max_output_power(&self) -> f32 {
        self.nodes()
            .fold(0.0, |highest, node| node.output_power.max(highest))
    }

    fn record(&self, speed: usize, force: usize) -> NodeRecord {
        let index = speed * self.force_axis.len() + force;
        NodeRecord::read(&self.nodes.as_chunks().0[index])
    }
}

impl Axis<'_> {
    const VALUE_BYTES: usize = 4;

    fn validate(self, place: Place) -> Result<(), DecodeError> {
        whole_records(self.0, Self::VALUE_BYTES).map_err(|problem| problem.at(place))?;
        if self.len() == 0 || self.len() > limits::MAX_AXIS_LEN {
            return Err(Problem::AxisLength(self.len()).at(place));
        }
        let mut before = None;
        for (index, value) in self.values().enumerate() {
            if !value.is_finite() || value.is_sign_negative() {
                return Err(Problem::AxisValue { index, value }.at(place));
            }
            if before.is_some_and(|before| value <= before) {
                return Err(Problem::AxisOrder { index }.at(place));
            }
            before = Some(value);
        }
        Ok(())
    }

    /// How many values there are, at least one.
    #[expect(clippy::len_without_is_empty, reason = "an axis is never empty")]
    pub fn len(&self) -> usize {
        self.0.len() / Self::VALUE_BYTES
    }

    /// Value `index`, which must be below [`Axis::len`].
    pub fn value(&self, index: usize) -> f32 {
        f32::from_le_bytes(self.0.as_chunks().0[index])
    }

    /// All values, ascending.
    pub fn values(&self) -> impl Iterator<Item = f32> {
        self.0.as_chunks().0.iter().copied().map(f32::from_le_bytes)
    }
}

impl Coefficients<'_> {
    /// The model's order.
    pub fn order(&self) -> usize {
        match self {
            Self::Lattice(codes) | Self::Direct16 { codes, .. } => codes.len(),
            Self::Direct32 { codes, .. } => codes.len(),
        }
    }

    fn validate(self) -> Result<(), Problem> {
        match self {
            Self::Lattice(codes) => {
                let full = |&code: &[u8; 2]| i16::from_le_bytes(code) == i16::MIN;
                match codes.iter().position(full) {
                    Some(index) => Err(Problem::ReflectionCoefficient { stage: index + 1 }),
                    None => Ok(()),
                }
            }
            Self::Direct16 { exponent, codes } => {
                let magnitude =
                    |&code: &[u8; 2]| u64::from(i16::from_le_bytes(code).unsigned_abs());
                let sum: u64 = codes.iter().map(magnitude).sum();
                check_sum(sum << exponent, 15)
            }
            Self::Direct32 { exponent, codes } => {
                let magnitude =
                    |&code: &[u8; 4]| u64::from(i32::from_le_bytes(code).unsigned_abs());
                let sum: u64 = codes.iter().map(magnitude).sum();
                // The first bound keeps the 64-bit sum of products from overflowing, whatever the history.
                if sum >= 1 << 32 {
                    return Err(Problem::CoefficientSum);
                }
                check_sum(sum << exponent, 31)
            }
        }
    }
}

/// Checks Σ|h|, given in steps of 2^-`fraction_bits`.
fn check_sum(sum: u64, fraction_bits: u32) -> Result<(), Problem> {
    if sum > limits::MAX_COEFFICIENT_SUM << fraction_bits {
        Err(Problem::CoefficientSum)
    } else {
        Ok(())
    }
}

fn whole_records(bytes: &[u8], record: usize) -> Result<(), Problem> {
    let found = bytes.len();
    if found.is_multiple_of(record) {
        Ok(())
    } else {
        Err(Problem::Ragged { found, record })
    }
}
