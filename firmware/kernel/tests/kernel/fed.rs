//! Fed textures: excitation from codebooks of a residual, from a level track, or both.

use std::f64::consts::{LN_2, LN_10};

use model_format::scene::Scene;
use model_format::{
    CodeSpec, CodebookSpec, ExcitationSpec, Library, ModulationSpec, NodeFlags, NodeSpec,
    PartsSpec, Structure, Texture, TextureSpec, encode_uncertified, encode_with_scenes_uncertified,
};
use proptest::prelude::*;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::feed::{FED_FRACTION_BITS, Feed, Material};
use stylus_kernel::grid::GridPoint;
use stylus_kernel::scene::{Plan, ScenePlayer};
use stylus_kernel::{MAX_FED_SAMPLES, Synthesis};

use crate::models::{STRUCTURES, fixture, motion, texture};
use crate::scenes::{at, side_by_side, texture_of};

/// One standard deviation of a fed excitation.
pub const SIGMA: f64 = (1u32 << FED_FRACTION_BITS) as f64;

/// Gaussian numbers of unit variance, for tests to make codebooks and tracks of.
pub fn gaussian(seed: u64) -> impl Iterator<Item = f64> {
    let mut source = Excitation::new(seed);
    std::iter::repeat_with(move || f64::from(source.next_sample()) / 2f64.powi(28))
}

/// The codebook of `samples`, scaled to a mean square of 1, by the formula of the format in floating point.
pub fn codebook(samples: &[f64]) -> CodebookSpec {
    let peak = samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
    let code = |x: &f64| {
        let magnitude = (1.0 + 255.0 * x.abs() / peak).ln() / (8.0 * LN_2) * 127.0;
        x.signum() as i8 * magnitude.round() as i8
    };
    let codes: Vec<i8> = samples.iter().map(code).collect();
    let square: f64 = codes.iter().map(|&code| share(code).powi(2)).sum();
    let peak = (codes.len() as f64 / square).sqrt() as f32;
    CodebookSpec { peak, codes }
}

/// Value of a code as a share of the peak, by the formula of the format in floating point.
fn share(code: i8) -> f64 {
    let magnitude = ((8.0 * LN_2 * f64::from(code.unsigned_abs()) / 127.0).exp() - 1.0) / 255.0;
    f64::from(code.signum()) * magnitude
}

/// Samples of a codebook, standard deviations.
pub fn values(codebook: &CodebookSpec) -> Vec<f64> {
    let peak = f64::from(codebook.peak);
    codebook.codes.iter().map(|&c| peak * share(c)).collect()
}

/// Independent samples of a kurtosis of about 20: a Gaussian times one that is cubed.
pub fn impulsive(samples: usize) -> CodebookSpec {
    let pairs: Vec<f64> = gaussian(1).take(2 * samples).collect();
    let samples: Vec<f64> = pairs
        .chunks(2)
        .map(|x| x[0] * (0.3 + x[1].powi(2)))
        .collect();
    codebook(&samples)
}

/// Nothing but impulses of 32 standard deviations, one in 1024 samples.
pub fn spikes() -> CodebookSpec {
    let samples: Vec<f64> = (0..8192)
        .map(|n| f64::from(u8::from(n % 1024 == 500)) * if n % 2048 < 1024 { 1.0 } else { -1.0 })
        .collect();
    codebook(&samples)
}

/// A level track of so many entries and samples between them, with a spread of `db` and a memory of some entries.
pub fn track(step_samples: u16, entries: usize, db: f64) -> ModulationSpec {
    let mut level = 0.0;
    let levels: Vec<f64> = gaussian(2)
        .take(entries)
        .map(|x| {
            level = 0.8 * level + 0.6 * x;
            level * db
        })
        .collect();
    let spec = |shift: f64| ModulationSpec {
        step_samples,
        entries: levels
            .iter()
            .map(|l| (4.0 * (l + shift)).round() as i8)
            .collect(),
    };
    let mean = |shift: f64| f64::from(spec(shift).mean_square());
    let shift = -10.0 * mean(0.0).log10();
    spec(shift - 10.0 * mean(shift).log10())
}

/// Codebook 1 at all `nodes`.
pub fn everywhere(codebook: CodebookSpec, nodes: usize) -> ExcitationSpec {
    ExcitationSpec {
        codebooks: vec![codebook],
        of_nodes: vec![1; nodes],
    }
}

/// The parts of a texture of four nodes: a codebook, a track, or both.
pub fn all_parts() -> [PartsSpec; 3] {
    let excitation = Some(everywhere(impulsive(4000), 4));
    let modulation = Some(track(100, 200, 4.0));
    let both = PartsSpec {
        excitation,
        modulation,
        lines: None,
    };
    [
        PartsSpec {
            modulation: None,
            ..both.clone()
        },
        PartsSpec {
            excitation: None,
            ..both.clone()
        },
        both,
    ]
}

fn fed(spec: TextureSpec, parts: PartsSpec) -> TextureSpec {
    TextureSpec { parts, ..spec }
}

/// A model of order 400 of `structure` at four nodes, fed by `parts`.
fn fed_h3(structure: Structure, parts: PartsSpec) -> TextureSpec {
    fed(
        texture_of("fed", structure, &fixture("H3").node(structure, 4.0)),
        parts,
    )
}

/// A texture that puts out its excitation at an RMS of 1 m/s².
fn bare(parts: PartsSpec) -> TextureSpec {
    let node = NodeSpec {
        output_power: 1.0,
        prediction_error_power: 1.0,
        flags: NodeFlags::NONE,
        codes: CodeSpec::lattice(Vec::new()),
    };
    fed(
        texture_of("bare", Structure::NormalisedLattice, &node),
        parts,
    )
}

fn encoded(spec: TextureSpec) -> Vec<u8> {
    encode_uncertified(&[spec]).expect("a valid library")
}

/// Excitation of a fed texture, standard deviations.
pub fn excitation(texture: &Texture<'_>, seed: u64) -> impl Iterator<Item = f64> {
    let material = Material::of(texture);
    let point = GridPoint::locate(texture, motion(75.0, 0.75));
    let mut feed = Feed::new(seed);
    std::iter::repeat_with(move || f64::from(feed.next_sample(&material, &point)) / SIGMA)
}

fn rms(samples: &[f64]) -> f64 {
    (samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64).sqrt()
}

/// 60 s; the standard deviation of a level with a track is about 0.1 dB.
#[test]
fn a_fed_texture_has_the_level_of_its_node_in_all_structures() {
    for structure in STRUCTURES {
        for parts in all_parts() {
            let bytes = encoded(fed_h3(structure, parts));
            let mut synthesis: Synthesis<'_> = Synthesis::new(texture(&bytes), 3);
            let mut samples = Vec::new();
            for _ in 0..30_000 {
                synthesis.follow(motion(75.0, 0.75), 10);
                samples.extend(
                    (0..10)
                        .map(|_| f64::from(synthesis.next_sample().metres_per_second_squared().0)),
                );
            }
            let level_db = 20.0 * (rms(&samples[5000..]) / 2.0).log10();
            println!("{structure}: {level_db:+.2} dB");
            assert!(level_db.abs() < 0.5, "{structure}: {level_db} dB");
            assert_eq!(synthesis.saturations(), 0);
        }
    }
}

#[test]
fn a_scene_of_one_texture_plays_what_the_texture_does() {
    for structure in STRUCTURES {
        for parts in all_parts() {
            let bytes = encoded(fed_h3(structure, parts));
            let mut alone: Synthesis<'_> = Synthesis::new(texture(&bytes), 3);
            let mut scene: ScenePlayer<'_> = ScenePlayer::new(Plan::of_texture(texture(&bytes)), 3);
            let mut heard = 0;
            for block in 0..400u16 {
                let motion = motion(60.0 + f32::from(block % 30), 0.75);
                scene.follow(at(0.0, motion), 10);
                // A direct form is silent while it is run up, and the scene's runs at other motions.
                if scene.block().stages().is_empty() {
                    continue;
                }
                if structure != Structure::NormalisedLattice {
                    break;
                }
                alone.follow(motion, 10);
                for _ in 0..10 {
                    assert_eq!(alone.next_sample(), scene.next_sample());
                }
                heard += 1;
            }
            assert!(heard > 300 || structure != Structure::NormalisedLattice);
        }
    }
}
