//! The library of test textures, made from a seed.
//!
//! Models are given by reflection coefficients, because magnitudes below one suffice for stability.

use alloc::vec::Vec;

use model_format::limits::{MAX_FINE_STAGES, MAX_ORDER};
use model_format::{
    CodeSpec, CodebookSpec, ExcitationSpec, FadeLaw, Laws, LevelLaw, LineSpec, LinesSpec, NodeSpec, PartsSpec,
    THETA_STEP_RAD, TailSpec, TextureSpec, Wander, encode,
};
use rand_core::Rng;
use rand_pcg::Pcg32;

/// Speeds and forces of the grid that the path covers.
const SPEEDS_MM_S: [f32; 3] = [40.0, 120.0, 240.0];
const FORCES_N: [f32; 2] = [0.5, 2.0];

/// Orders of neighbouring nodes. They differ, and include odd orders and order zero.
const UNEQUAL_ORDERS: [usize; 6] = [MAX_ORDER, 37, 1, 250, 399, 0];

/// Number of stages that have fractions in a compact lattice, as `stylus fit` writes it.
const COMPACT_FINE_STAGES: usize = 24;

/// Order of models for which the order does not matter.
const SHORT_ORDER: usize = 60;

/// Wavelengths, mm, and phases of lines. The wavelengths are the shortest and the longest that are allowed, and two
/// that a hand feels.
const FOUR_LINES: [(f32, u16); 4] = [(0.02, 1), (0.61, 0x4000), (2.0, 0xffff), (1000.0, 0)];

/// Wanders: one of threads, and one of a resonance that keeps its frequency.
const WANDERS: [Wander; 2] = [
    Wander {
        rms_mm: 0.15,
        correlation_mm: 4.0,
        clock_mm_s: 0.0,
    },
    Wander {
        rms_mm: 0.1,
        correlation_mm: 0.5,
        clock_mm_s: 90.0,
    },
];

/// Returns the bytes of a library that holds every texture of [`crate::VECTORS`].
///
/// # Panics
/// Never, because the textures are valid.
pub fn library() -> Vec<u8> {
    encode(&specs()).expect("the test textures are valid")
}

/// The textures of [`library`].
pub fn specs() -> [TextureSpec; 12] {
    let resonant = |index| Model::resonant(MAX_ORDER, index);
    let one = Grid::one(&Model::resonant(MAX_ORDER, 1), 9.0);
    [
        one.texture("lattice, one node"),
        Grid::new(|index| resonant(index as u64)).texture("lattice"),
        Grid::new(|index| Model::resonant(UNEQUAL_ORDERS[index], 10 + index as u64))
            .with_rest()
            .texture("lattice of unequal orders"),
        Grid::new(Model::extreme).texture("lattice of largest angles"),
        Grid::new(|index| resonant(index as u64).with_fractions(30 + index as u64))
            .with_laws(LevelLaw::Logarithm, FadeLaw::Power)
            .texture("fine lattice, mean dB"),
        Grid::new(|index| Model::extreme(index).with_largest_fractions())
            .with_laws(LevelLaw::Amplitude, FadeLaw::Amplitude)
            .texture("fine lattice of largest angles, mean amplitude"),
        Grid::new(|index| resonant(index as u64))
            .with_lines(&FOUR_LINES)
            .texture("lattice, four lines"),
        Grid::new(|index| Model::gentle(SHORT_ORDER, 60 + index as u64))
            .with_rest()
            .with_laws(LevelLaw::Power, FadeLaw::Power)
            .with_lines(&FOUR_LINES[1..2])
            .texture("lattice with rest, one line"),
        Grid::new(|index| resonant(110 + index as u64))
            .with_codebooks()
            .with_lines(&FOUR_LINES)
            .texture("lattice, snippets and four lines"),
        Grid::new(|index| resonant(130 + index as u64).with_fractions(40 + index as u64).compact())
            .with_laws(LevelLaw::Logarithm, FadeLaw::Power)
            .texture("compact lattice, mean dB"),
        Grid::new(|index| resonant(150 + index as u64))
            .with_lines(&FOUR_LINES)
            .with_wanders()
            .texture("lattice, four lines that wander"),
        Grid::new(|index| resonant(150 + index as u64))
            .with_codebooks()
            .texture("lattice, snippets"),
    ]
}

/// Digest of the words that the texture of [`digest_library`] plays along the fixed stroke of
/// [`stylus_kernel::digest`]. It is the same on every platform: host, emulated processors, emulated board and browser.
pub const DIGESTED: u32 = 0x487f_7996;

/// Returns the bytes of a library of one texture that has every part but tails, and whose order is low enough to
/// play fast.
///
/// # Panics
/// Never, because the texture is valid.
pub fn digest_library() -> Vec<u8> {
    let spec = Grid::new(|index| Model::resonant(SHORT_ORDER, 120 + index as u64).with_fractions(index as u64))
        .with_laws(LevelLaw::Logarithm, FadeLaw::Power)
        .with_codebooks()
        .with_lines(&FOUR_LINES[1..3])
        .with_wanders()
        .texture("digest");
    encode(&[spec]).expect("the texture is valid")
}

/// Orders whose costs are counted.
pub const COUNTED_ORDERS: [usize; 6] = [10, 20, 50, 100, 200, MAX_ORDER];

/// Returns a library of textures whose costs are counted: each of `orders` on one node, then each on the whole grid.
///
/// # Panics
/// An order is above the limit or comes twice, or the library is too large.
pub fn counted_library(orders: &[usize]) -> Vec<u8> {
    let one = |&order: &usize| {
        Grid::one(&Model::gentle(order, order as u64), 9.0).texture(&alloc::format!("order {order}, one node"))
    };
    let grid = |&order: &usize| counted_texture(order, &alloc::format!("order {order}, four nodes"));
    let textures: Vec<TextureSpec> = orders.iter().map(one).chain(orders.iter().map(grid)).collect();
    encode(&textures).expect("the textures are valid")
}

/// Returns a texture of `order` on the whole grid, called `name`.
pub fn counted_texture(order: usize, name: &str) -> TextureSpec {
    Grid::new(|index| Model::gentle(order, (order + index) as u64)).texture(name)
}

/// An all-pole model, given by the arcsines of its reflection coefficients in stored steps, and their fractions (fine
/// bytes).
#[derive(Clone)]
struct Model {
    theta_codes: Vec<i16>,
    fractions: Vec<i8>,
    /// True if the model's lattice has a tail.
    is_compact: bool,
}

impl Model {
    fn from_reflection(coefficients: impl Iterator<Item = f64>) -> Self {
        let code = |k: f64| libm::round(libm::asin(k) / THETA_STEP_RAD) as i16;
        Self {
            theta_codes: coefficients.map(code).collect(),
            fractions: Vec::new(),
            is_compact: false,
        }
    }

    /// The model in the form that `stylus fit` chooses for most surfaces: fractions only for the first stages, and a
    /// tail.
    fn compact(self) -> Self {
        Self {
            is_compact: true,
            ..self
        }
    }

    /// The model with a random fraction for each stage that can have one.
    fn with_fractions(self, seed: u64) -> Self {
        let mut uniform = uniform(seed);
        let fraction = |_| (128.0 * uniform()) as i8;
        Self {
            fractions: (0..MAX_FINE_STAGES).map(fraction).collect(),
            ..self
        }
    }

    /// The model with fractions of the largest magnitude, each with the sign of its stage's code.
    fn with_largest_fractions(self) -> Self {
        let fraction = |&code: &i16| if code < 0 { i8::MIN } else { i8::MAX };
        let fine = self.theta_codes.iter().take(MAX_FINE_STAGES);
        Self {
            fractions: fine.map(fraction).collect(),
            ..self
        }
    }

    /// A model whose reflection coefficients fall like 1/m and are uniform in ±`first`/m. `head` replaces the first
    /// ones.
    fn decaying(order: usize, first: f64, head: &[f64], seed: u64) -> Self {
        let mut uniform = uniform(seed);
        Self::from_reflection((1..=order).map(|stage| {
            let drawn = first / stage as f64 * uniform();
            head.get(stage - 1).copied().unwrap_or(drawn)
        }))
    }

    /// A model without resonances.
    fn gentle(order: usize, seed: u64) -> Self {
        Self::decaying(order, 0.1, &[], seed)
    }

    /// A model with a resonance of pole radius about 0.99, whose frequency depends on the seed, and a long tail.
    fn resonant(order: usize, seed: u64) -> Self {
        let frequency_rad = 0.2 + (0.3 * seed as f64) % 2.8;
        let head = [-libm::cos(frequency_rad) * 0.999, 0.98];
        Self::decaying(order, 0.4, &head, seed)
    }

    /// A model with the largest reflection coefficients that can be stored, all of one sign or of alternating signs.
    fn extreme(index: usize) -> Self {
        let code = |stage: usize| match index % 3 {
            0 => i16::MAX,
            1 => -i16::MAX,
            _ if stage.is_multiple_of(2) => i16::MAX,
            _ => -i16::MAX,
        };
        Self {
            theta_codes: (0..MAX_ORDER).map(code).collect(),
            fractions: Vec::new(),
            is_compact: false,
        }
    }

    fn lattice(&self) -> CodeSpec {
        let whole = CodeSpec {
            codes: self.theta_codes.clone(),
            fractions: self.fractions.clone(),
            tail: TailSpec::default(),
        };
        if self.is_compact {
            let thetas: Vec<i32> = whole.thetas().collect();
            CodeSpec::compact_lattice(&thetas, COMPACT_FINE_STAGES)
        } else {
            whole
        }
    }
}

/// Models at the nodes of a grid of speeds and forces, speed-major, with their output powers, (m/s²)².
struct Grid {
    speeds_mm_s: Vec<f32>,
    forces_n: Vec<f32>,
    models: Vec<(Model, f32)>,
    laws: Laws,
    lines: Vec<(f32, u16)>,
    wanders: &'static [Wander],
    parts: PartsSpec,
}

impl Grid {
    /// Models on the whole grid, whose output power rises with the index of the node.
    fn new(model: impl Fn(usize) -> Model) -> Self {
        let count = SPEEDS_MM_S.len() * FORCES_N.len();
        Self {
            speeds_mm_s: SPEEDS_MM_S.to_vec(),
            forces_n: FORCES_N.to_vec(),
            models: (0..count)
                .map(|index| (model(index), 0.5 + 2.5 * index as f32))
                .collect(),
            laws: Laws::default(),
            lines: Vec::new(),
            wanders: &[],
            parts: PartsSpec::default(),
        }
    }

    /// A grid of one node.
    fn one(model: &Model, output_power: f32) -> Self {
        Self {
            speeds_mm_s: SPEEDS_MM_S[..1].to_vec(),
            forces_n: FORCES_N[..1].to_vec(),
            models: [(model.clone(), output_power)].to_vec(),
            ..Self::new(|_| model.clone())
        }
    }

    /// The grid with these laws of the level.
    fn with_laws(self, level: LevelLaw, fade: FadeLaw) -> Self {
        let laws = Laws { level, fade };
        Self { laws, ..self }
    }

    /// The grid with lines of these wavelengths, mm, and phases. The lines' amplitudes rise with the index of the node.
    fn with_lines(self, lines: &[(f32, u16)]) -> Self {
        let lines = lines.to_vec();
        Self { lines, ..self }
    }

    /// The grid with lines to which the wanders of [`WANDERS`] are assigned in turn.
    fn with_wanders(self) -> Self {
        Self {
            wanders: &WANDERS,
            ..self
        }
    }

    fn lines(&self) -> Option<LinesSpec> {
        let amplitude = |(index, (_, power)): (usize, &(Model, f32))| {
            if *power > 0.0 { 0.25 + 0.125 * index as f32 } else { 0.0 }
        };
        let line = |&(wavelength_mm, phase): &(f32, u16)| LineSpec {
            wavelength_mm,
            phase,
            amplitudes: self.models.iter().enumerate().map(amplitude).collect(),
            ..LineSpec::default()
        };
        let mut lines: Vec<_> = self.lines.iter().map(line).collect();
        for (index, line) in lines.iter_mut().enumerate() {
            line.wander = (index as u8).checked_rem(self.wanders.len() as u8);
        }
        (!lines.is_empty()).then(|| LinesSpec::with_wanders(lines, self.wanders))
    }

    /// The grid with two codebooks. Some nodes have the first, some the second, some none.
    fn with_codebooks(mut self) -> Self {
        let nodes = 0..self.models.len();
        self.parts.excitation = Some(ExcitationSpec {
            codebooks: [codebook(30, 4), codebook(41, 5)].to_vec(),
            of_nodes: nodes.map(|node| [1, 2, 0][node % 3]).collect(),
        });
        self
    }

    /// The grid with silent nodes at speed zero.
    fn with_rest(mut self) -> Self {
        self.speeds_mm_s.insert(0, 0.0);
        let silent = FORCES_N.map(|_| (Model::gentle(5, 99), 0.0));
        self.models.splice(0..0, silent);
        self
    }

    fn texture(&self, name: &str) -> TextureSpec {
        let nodes = self
            .models
            .iter()
            .map(|(model, power)| NodeSpec::new(*power, model.lattice()));
        TextureSpec {
            laws: self.laws,
            parts: PartsSpec {
                lines: self.lines(),
                ..self.parts.clone()
            },
            ..TextureSpec::new(name, &self.speeds_mm_s, &self.forces_n, nodes.collect())
        }
    }
}

/// A codebook of `count` blocks, whose levels are spread over 32 dB. The second half of each block is the first half
/// negated, so that there is no mean.
fn codebook(count: usize, seed: u64) -> CodebookSpec {
    let mut uniform = uniform(seed);
    let mut blocks = Vec::new();
    for _ in 0..count {
        let half: Vec<u8> = (0..12).map(|_| (127.0 * uniform()) as i8 as u8).collect();
        // The third bit of each code of three bits.
        let minus = [0x24, 0x49, 0x92].into_iter().cycle();
        blocks.extend(&half);
        blocks.extend(half.iter().zip(minus).map(|(codes, minus)| codes ^ minus));
        blocks.push((-32.0 + 32.0 * uniform()) as i8 as u8);
    }
    CodebookSpec::of_unit_power(blocks)
}

/// Returns a generator of numbers that are uniform in ±1.
fn uniform(seed: u64) -> impl FnMut() -> f64 {
    const STREAM: u64 = 0x5eed;
    let mut generator = Pcg32::new(seed, STREAM);
    move || f64::from(generator.next_u32() as i32) / libm::exp2(31.0)
}
