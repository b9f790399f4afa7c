//! The bounds on the work of decoding a library, of one step of decoding, and of a plan. Valid libraries that are
//! hostile must stay below them on an emulated Cortex-M4. Some have each property at one end of its range, and others
//! are random.
//!
//! `STYLUS_HOSTILE_LIBRARIES` sets the number of random libraries, and `STYLUS_ATTACK_SEED` their seed.

use kernel_vectors::job::{CAPACITY, Job, OVERHEAD_BYTES};
use kernel_vectors::{Libraries, report};
use model_format::limits::{
    DECODE_INSTRUCTIONS, DECODE_INSTRUCTIONS_PER_BYTE, DECODE_INSTRUCTIONS_PER_SCENE, DECODE_INSTRUCTIONS_PER_TEXTURE,
    MAX_AXIS_LEN, MAX_CODEBOOKS, MAX_EXCITATION_BYTES, MAX_FINE_STAGES, MAX_LIBRARY_BYTES, MAX_LINES, MAX_NAME_BYTES,
    MAX_ORDER, MAX_TEXTURES, MAX_WANDERS, PLAN_INSTRUCTIONS, STEP_INSTRUCTIONS,
};
use model_format::scene::limits::{MAX_REGIONS, MAX_SCENES, MAX_SECTIONS, MAX_SURFACES};
use model_format::scene::{Biquad, Region, Scene, StickSlip, Surface, Tap};
use model_format::{
    BLOCK_BYTES, CodeSpec, CodebookSpec, ExcitationSpec, FadeLaw, Laws, LevelLaw, LineSpec, LinesSpec, NodeSpec,
    PartsSpec, Problem, Provenance, SAMPLE_RATE_HZ, TailSpec, TextureSpec, Wander, encode_with_scenes,
};
use tasks::qemu;
use tasks::qemu::Processor;

use crate::{held, image};

/// Number of random libraries.
const DRAWN: u64 = 100;

/// Seed of the random libraries.
const SEED: u64 = 14;

/// Largest size of every library but the last, bytes. The work per byte does not depend on the library's size.
const DRAWN_BYTES: usize = 48 * 1024;

/// Number of codes per codebook, in bytes. Four codebooks and one byte for each of 4096 nodes use nearly all bytes that
/// an excitation may have.
const CODEBOOK_BYTES: usize = (MAX_EXCITATION_BYTES - MAX_AXIS_LEN * MAX_AXIS_LEN) / MAX_CODEBOOKS - 16;

/// Number of properties of a recipe.
const PROPERTIES: usize = 20;

/// Lowest and highest value of each property.
const RANGES: [(u32, u32); PROPERTIES] = [
    (1, MAX_TEXTURES as u32),    // Textures.
    (1, MAX_TEXTURES as u32),    // Textures with a grid.
    (1, MAX_AXIS_LEN as u32),    // Speeds.
    (1, MAX_AXIS_LEN as u32),    // Forces.
    (0, MAX_ORDER as u32),       // Order.
    (0, 1),                      // Whether there are tails.
    (0, MAX_FINE_STAGES as u32), // Stages with a fine byte.
    (0, 2),                      // Index of the level's law.
    (2, MAX_NAME_BYTES as u32),  // Bytes per name.
    (0, 1),                      // Whether names have characters of several bytes.
    (0, MAX_SCENES as u32),      // Scenes.
    (1, MAX_SURFACES as u32),    // Surfaces.
    (1, MAX_SURFACES as u32),    // Textures of surfaces.
    (0, MAX_SURFACES as u32),    // Taps.
    (0, MAX_SURFACES as u32),    // Stick-slips.
    (0, MAX_SECTIONS as u32),    // Sections.
    (0, MAX_REGIONS as u32),     // Regions.
    (0, MAX_CODEBOOKS as u32),   // Codebooks of the first texture.
    (0, MAX_LINES as u32),       // Lines.
    (0, MAX_WANDERS as u32),     // Wanders, at most as many as lines.
];

/// The properties of a hostile library.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Recipe([u32; PROPERTIES]);

/// The costs of a library, in instructions.
#[derive(Clone, Copy, Debug)]
struct Cost {
    bytes: u64,
    decode: u64,
    longest_step: u64,
    plan: u64,
}

/// A generator of random numbers: it hashes the terms of a sequence with constant increments (Steele, Lea and Flood,
/// *Fast splittable pseudorandom number generators*, OOPSLA 2014).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: u32) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut hashed = self.0;
        hashed = (hashed ^ (hashed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hashed = (hashed ^ (hashed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (((hashed >> 32) * u64::from(limit)) >> 32) as u32
    }
}

impl Recipe {
    fn random(numbers: &mut Numbers) -> Self {
        Self(RANGES.map(|(lowest, highest)| match numbers.below(3) {
            0 => lowest,
            1 => highest,
            _ => lowest + numbers.below(highest - lowest + 1),
        }))
    }

    /// Builds the library, which is valid. The grids shrink until it has at most `most` bytes.
    fn library(mut self, most: usize) -> Vec<u8> {
        loop {
            if self.texture_bytes() <= most {
                let textures: Vec<_> = (0..self.0[0]).map(|index| self.texture(index)).collect();
                let scenes: Vec<_> = (0..self.0[10]).map(|index| self.scene(index)).collect();
                match encode_with_scenes(&textures, &scenes) {
                    Ok(bytes) if bytes.len() <= most => return bytes,
                    Ok(_) => {}
                    Err(error) => assert!(matches!(error.problem, Problem::Range { .. }), "{error}: {self:?}"),
                }
            }
            // Reduces the largest of order, forces, speeds and number of textures with a grid.
            let at = [4, 3, 2, 1].into_iter().max_by_key(|&at| self.0[at]);
            let largest = &mut self.0[at.expect("there are four")];
            if *largest > 1 {
                *largest = *largest * 3 / 4;
            } else {
                self.0[0] = self.0[0] * 3 / 4;
            }
        }
    }

    /// Smallest number of bytes that the textures can have.
    fn texture_bytes(&self) -> usize {
        let [textures, with_grid, speeds, forces, order, tails, ..] = self.0.map(|n| n as usize);
        let lines = self.0[18] as usize;
        let coefficients = order + if tails == 1 { order.min(MAX_FINE_STAGES) } else { order };
        let node = 16 + coefficients + 4 * lines;
        let with_grid = with_grid.min(textures);
        let parts = self.0[17] as usize * CODEBOOK_BYTES;
        with_grid * speeds * forces * node + (textures - with_grid) * node + parts
    }

    fn name(&self, index: u32) -> String {
        let last = format!("{index:02x}");
        let room = self.0[8] as usize - last.len().min(self.0[8] as usize);
        let filler = if self.0[9] == 1 { 'ß' } else { 'x' };
        let fill = room / filler.len_utf8();
        core::iter::repeat_n(filler, fill).chain(last.chars()).collect()
    }

    fn texture(&self, index: u32) -> TextureSpec {
        let with_grid = index < self.0[1];
        let (speeds, forces) = if with_grid { (self.0[2], self.0[3]) } else { (1, 1) };
        let order = self.0[4];
        let axis = |len: u32| (1..=len).map(|value| value as f32).collect::<Vec<_>>();
        let before = match self.0[5] {
            1 => order.min(MAX_FINE_STAGES as u32),
            _ => order,
        };
        let codes = CodeSpec {
            codes: (0..before).map(|at| (at * 71 % 30_000) as i16 - 15_000).collect(),
            fractions: (0..order.min(self.0[6])).map(|at| at as i8 + 1).collect(),
            tail: TailSpec {
                codes: (before..order)
                    .map(|at| (127 - ((at - before) % 255).cast_signed()) as i8)
                    .collect(),
                step: if before < order { 300 } else { 0 },
            },
        };
        let node = |number: u32| NodeSpec::new(1.0 + number as f32, codes.clone());
        TextureSpec {
            name: self.name(index),
            sample_rate_hz: SAMPLE_RATE_HZ,
            provenance: Provenance::Simulated,
            laws: Laws {
                level: LevelLaw::ALL[self.0[7] as usize],
                fade: FadeLaw::Amplitude,
            },
            parts: PartsSpec {
                lines: self.lines((speeds * forces) as usize),
                ..if index == 0 {
                    self.parts(speeds * forces)
                } else {
                    PartsSpec::default()
                }
            },
            speed_axis_mm_s: axis(speeds),
            force_axis_n: axis(forces),
            nodes: (0..speeds * forces).map(node).collect(),
        }
    }

    fn lines(&self, nodes: usize) -> Option<LinesSpec> {
        let [.., lines, wanders] = self.0;
        let wanders = wanders.min(lines);
        let line = |at: u32| LineSpec {
            wavelength_mm: 1.0 + at as f32,
            phase: 7,
            amplitudes: vec![0.1; nodes],
            // The last lines have the wanders, so that the search for a wander's line is longest.
            wander: (lines - at <= wanders).then(|| (at + wanders - lines) as u8),
        };
        let wander = Wander {
            rms_mm: 0.1,
            correlation_mm: 1.0,
            clock_mm_s: 90.0,
        };
        (lines > 0).then(|| LinesSpec {
            lines: (0..lines).map(line).collect(),
            wanders: vec![wander; wanders as usize],
        })
    }

    /// Codebooks of a texture with `nodes` nodes. There are at most as many codebooks as nodes.
    fn parts(&self, nodes: u32) -> PartsSpec {
        let codebooks = self.0[17].min(nodes);
        // Each code has the highest magnitude and either sign in turn, and the level of each block is 0.
        let block = [[0xfb, 0xbe, 0xef].repeat(8), vec![0]].concat();
        let codebook = CodebookSpec {
            peak: 1.0,
            blocks: block.repeat(CODEBOOK_BYTES / BLOCK_BYTES),
        };
        PartsSpec {
            excitation: (codebooks > 0).then(|| ExcitationSpec {
                codebooks: vec![codebook; codebooks as usize],
                of_nodes: (0..nodes).map(|node| (node % codebooks) as u8 + 1).collect(),
            }),
            ..PartsSpec::default()
        }
    }

    fn scene(&self, index: u32) -> Scene {
        let [
            textures,
            ..,
            surfaces,
            used,
            taps,
            stick_slips,
            sections,
            regions,
            _,
            _,
            _,
        ] = self.0;
        let surface = |at: u32| Surface {
            texture: Some((textures - 1 - at % used.min(textures)) as u8),
            gain: 1.0,
            tap: (at < taps).then_some(Tap {
                frequency_hz: 100.0 + 130.0 * at as f32,
                decay_s: 0.01 + 0.01 * at as f32,
                gain_m_s2_per_n_s: 1.0,
                limit_m_s2: 100.0,
            }),
            stick_slip: (at < stick_slips).then_some(StickSlip {
                period_mm: 1.0,
                duty: 0.5,
                depth: 0.5,
                below_mm_s: 60.0,
                above_n: 1.0,
            }),
        };
        let region = |at: u32| Region {
            start_mm: at as f32,
            end_mm: (at + 1) as f32,
            surface: (at % surfaces) as u8,
        };
        // Narrow peaks next to each other, with a gain near the limit. For these the band is halved most often.
        let section = |at: u32| {
            const RADIUS: f64 = 0.999;
            const ZEROS: f64 = 1.0 - 15.0 * (1.0 - RADIUS);
            let cosine = (0.02 + 0.48 / 7.0 * f64::from(at)).cos();
            let gain = if at == 0 { 0.98 } else { 1.0 };
            let zeros = [1.0, -2.0 * ZEROS * cosine, ZEROS * ZEROS].map(|b| b * gain);
            Biquad::from_f64(zeros, [-2.0 * RADIUS * cosine, RADIUS * RADIUS]).expect("it is in range")
        };
        let name = self.name(index);
        let mut scene = Scene::of_surface(
            name.as_str().try_into().expect("it is short"),
            SAMPLE_RATE_HZ,
            surface(0),
        );
        scene.surfaces = (0..surfaces).map(surface).collect();
        scene.regions = (0..regions).map(region).collect();
        scene.equaliser = (0..sections).map(section).collect();
        scene
    }
}

/// Number of instructions that the bounds allow for decoding.
fn allowed(cost: Cost, recipe: Recipe) -> u64 {
    DECODE_INSTRUCTIONS
        + cost.bytes * DECODE_INSTRUCTIONS_PER_BYTE
        + u64::from(recipe.0[0]) * DECODE_INSTRUCTIONS_PER_TEXTURE
        + u64::from(recipe.0[10]) * DECODE_INSTRUCTIONS_PER_SCENE
}

/// Measures the costs of `recipes` on the emulator, and returns them in order.
fn measured(image: &std::path::Path, recipes: &[Recipe], most: usize) -> Vec<Cost> {
    let mut jobs: Vec<Vec<u8>> = vec![Vec::new()];
    for recipe in recipes {
        let library = recipe.library(most);
        let last = jobs.last().map_or(0, Vec::len);
        if last + library.len() + 4 + OVERHEAD_BYTES > CAPACITY {
            jobs.push(Vec::new());
        }
        Libraries::append(&library, jobs.last_mut().expect("there is one"));
    }
    let mut costs = Vec::new();
    for libraries in &jobs {
        let job = Job::Bounds { libraries };
        let text = held(qemu::run(Processor::CortexM4, image, Some(&job)));
        assert_eq!(text.lines().last().map(str::trim_end), Some(report::END));
        for line in text.lines().filter_map(|line| line.strip_prefix(report::LIBRARY_COST)) {
            let numbers: Vec<u64> = line.split_whitespace().map(|n| n.parse().unwrap()).collect();
            let [bytes, decode, _, longest_step, plan] = numbers[..] else {
                panic!("{line}");
            };
            costs.push(Cost {
                bytes,
                decode,
                longest_step,
                plan,
            });
        }
    }
    assert_eq!(costs.len(), recipes.len(), "a library was not measured");
    costs
}

/// Recipes to begin with: all properties at their lowest and at their highest values, and each property at one end of
/// its range with all others at the opposite end.
fn beginnings() -> Vec<Recipe> {
    let least = Recipe(RANGES.map(|(lowest, _)| lowest));
    let most = Recipe(RANGES.map(|(_, highest)| highest));
    let mut recipes = vec![least, most];
    for (at, (lowest, highest)) in RANGES.into_iter().enumerate() {
        let (mut one, mut other) = (least, most);
        one.0[at] = highest;
        other.0[at] = lowest;
        recipes.extend([one, other]);
    }
    // Grids with tails, from short to long ones.
    for order in [33, 64, MAX_ORDER as u32] {
        let mut tails = least;
        for (at, value) in [(2, 8), (3, 8), (4, order), (5, 1), (6, 32)] {
            tails.0[at] = value;
        }
        recipes.push(tails);
    }
    recipes
}

/// The number in the environment variable called `name`, if it is set.
fn number(name: &str) -> Option<u64> {
    let text = std::env::var(name).ok()?;
    let number = text.parse();
    Some(number.unwrap_or_else(|_| panic!("{name}={text} is not a whole number")))
}

#[test]
fn no_valid_library_takes_more_work_than_its_bound() {
    let drawn = number("STYLUS_HOSTILE_LIBRARIES").unwrap_or(DRAWN);
    let mut numbers = Numbers(number("STYLUS_ATTACK_SEED").unwrap_or(SEED));
    let image = image(Processor::CortexM4);
    let mut recipes = beginnings();
    recipes.extend((0..drawn).map(|_| Recipe::random(&mut numbers)));
    let costs = measured(&image, &recipes, DRAWN_BYTES);
    let mut tried: Vec<(Recipe, Cost)> = recipes.into_iter().zip(costs).collect();
    // The large recipe with the most work per byte is tried again with enough grids to fill a slot.
    let large = tried.iter().filter(|(_, cost)| cost.bytes > 40_000);
    let worst = large.max_by_key(|(_, cost)| cost.decode * 1000 / cost.bytes);
    let mut whole = worst.expect("the first recipes are large").0;
    (whole.0[0], whole.0[1]) = (MAX_TEXTURES as u32, MAX_TEXTURES as u32);
    let costs = measured(&image, &[whole], MAX_LIBRARY_BYTES);
    println!("a full slot: {:?}", costs[0]);
    tried.push((whole, costs[0]));
    for (recipe, cost) in tried {
        let decode = allowed(cost, recipe);
        assert!(cost.decode <= decode, "{cost:?}, allowed {decode}: {recipe:?}");
        assert!(cost.longest_step <= STEP_INSTRUCTIONS, "{cost:?}: {recipe:?}");
        assert!(cost.plan <= PLAN_INSTRUCTIONS, "{cost:?}: {recipe:?}");
    }
}
