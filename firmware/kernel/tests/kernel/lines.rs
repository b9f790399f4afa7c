//! Lines that are tied to position.

use std::f64::consts::TAU;

use model_format::{
    FadeLaw, Library, LineSpec, LinesSpec, NodeSpec, OutputSample, SAMPLE_RATE_HZ, Texture, Wander, encode,
    encode_with_scenes,
};
use stylus_kernel::position::Position;
use stylus_kernel::scene::cost::Item;
use stylus_kernel::scene::{Interaction, Plan, ScenePlayer, Stage};
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::models::{fixture, motion, side_by_side, spec, texture as only_texture};

const RATE: f64 = SAMPLE_RATE_HZ as f64;
const BLOCK: usize = UPDATE_INTERVAL_SAMPLES as usize;

/// A library of one texture that is silent except for `lines`, each given as wavelength, mm, phase, turns, and
/// amplitude, m/s².
///
/// The grid is one node at 10 mm/s and 0.5 N, so that all speeds of a hand lie above it.
fn silent_but_for(lines: &[(f32, f64, f32)]) -> Vec<u8> {
    let silent = vec![NodeSpec::silent()];
    let mut spec = spec(&[10.0], &[0.5], silent);
    let line = |&(wavelength_mm, phase, amplitude): &(f32, f64, f32)| LineSpec {
        wavelength_mm,
        phase: (phase * 65_536.0) as u16,
        amplitudes: vec![amplitude],
        ..LineSpec::default()
    };
    spec.parts.lines = Some(LinesSpec {
        lines: lines.iter().map(line).collect(),
        ..LinesSpec::default()
    });
    encode(&[spec]).expect("a valid library")
}

/// One line of phase 0.
fn line_of(wavelength_mm: f32, amplitudes: Vec<f32>) -> LinesSpec {
    let line = LineSpec {
        wavelength_mm,
        phase: 0,
        amplitudes,
        ..LineSpec::default()
    };
    LinesSpec::from(vec![line])
}

fn m_s2(sample: OutputSample) -> f64 {
    f64::from(sample.0) / f64::from(1u32 << OutputSample::FRACTION_BITS)
}

/// Times of the first and the last sample of the block with this number, s.
fn times(block: usize) -> [f64; 2] {
    [block * BLOCK, (block + 1) * BLOCK - 1].map(|sample| sample as f64 / RATE)
}

/// The samples of a block of `motion` that ends at a position.
fn block(synthesis: &mut Synthesis<'_>, motion: Motion, end: Option<Position>) -> [f64; BLOCK] {
    synthesis.follow_to(motion, end, UPDATE_INTERVAL_SAMPLES);
    [(); BLOCK].map(|()| m_s2(synthesis.next_sample()))
}

/// Returns the samples of `texture` while the tool moves along `position_mm(t)`. The position is given for the end of
/// each block, with the speed at its beginning.
fn played(texture: Texture<'_>, seconds: f64, position_mm: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture, 1);
    let mut samples = Vec::new();
    for number in 0..(seconds * RATE) as usize / BLOCK {
        let [begin, end] = times(number);
        let speed = (position_mm(begin + 1e-4) - position_mm(begin - 1e-4)) / 2e-4;
        let position = Position::from_exact_mm(position_mm(end));
        let motion = motion(speed as f32, 1.0);
        samples.extend(block(&mut synthesis, motion, Some(position)));
    }
    samples
}

/// Compares with the definition in floats, with the position linear within a block: at constant speed, in acceleration
/// from 20 to 300 mm/s, and back and forth, so that a place feels the same in both directions.
#[test]
fn lines_are_the_sines_of_the_position() {
    let lines = [(0.61, 0.25, 1.5), (2.0, 0.9, 0.3), (731.0, 0.0, 4.0)];
    let bytes = silent_but_for(&lines);
    let ways: [fn(f64) -> f64; 4] = [
        |t| 37.7 * t,
        |t| 20.0 * t + 70.0 * t * t,
        |t| 1000.0 + 120.0 * t + 30.0 * (3.0 * t).sin(),
        |t| 30.0 * (TAU * 1.5 * t).sin(),
    ];
    for (way, position_mm) in ways.into_iter().enumerate() {
        let samples = played(only_texture(&bytes), 2.0, position_mm);
        let time = |last: usize| (last as f64 - 1.0) / RATE;
        let ends = |n: usize| [n / BLOCK, n / BLOCK + 1].map(|block| position_mm(time(block * BLOCK)));
        // Near a turn the line fades with the speed.
        let speed = |n: usize| (ends(n)[1] - ends(n)[0]).abs() * RATE / BLOCK as f64;
        let moves = |n: usize| n >= 2 * BLOCK && [n - BLOCK, n].into_iter().all(|n| speed(n) > 19.0);
        let mut compared = 0;
        for (n, sample) in samples.iter().enumerate().filter(|&(n, _)| moves(n)) {
            let [from, to] = ends(n);
            let x = from + (to - from) * (n % BLOCK + 1) as f64 / BLOCK as f64;
            let exact: f64 = lines
                .iter()
                .map(|&(wavelength, phase, amplitude)| {
                    let turns = x / f64::from(wavelength) + (phase * 65_536.0).floor() / 65_536.0;
                    f64::from(amplitude) * (turns * TAU).sin()
                })
                .sum();
            assert!(
                (sample - exact).abs() < 2e-5,
                "way {way}, sample {n}: {sample}, not {exact}"
            );
            compared += 1;
        }
        assert!(compared > 7000, "way {way}: {compared}");
    }
}

/// A library of a texture that is silent except for a wandering line of this wavelength, with amplitude 1.
fn wandering(wavelength_mm: f32, wander: Wander) -> Vec<u8> {
    let mut spec = spec(&[10.0], &[0.5], vec![NodeSpec::silent()]);
    let mut lines = line_of(wavelength_mm, vec![1.0]);
    lines.wanders = vec![wander];
    lines.lines[0].wander = Some(0);
    spec.parts.lines = Some(lines);
    encode(&[spec]).expect("a valid library")
}

/// A wander that is 1.5 rad of a wavelength of 0.85 mm.
const OF_THREADS: Wander = Wander {
    rms_mm: 0.2,
    correlation_mm: 8.0,
    clock_mm_s: 0.0,
};

/// Another movement over the same places, at other speeds and with other blocks, meets the same threads; so does the
/// movement back.
#[test]
fn a_wandering_line_is_a_function_of_the_place_and_its_harmonics_stay_locked() {
    let at_block_ends = |bytes: &[u8], position_mm: fn(f64) -> f64| -> Vec<(f64, f64)> {
        played(only_texture(bytes), 2.0, position_mm)
            .chunks_exact(BLOCK)
            .enumerate()
            .skip(2)
            .map(|(number, block)| (position_mm(times(number)[1]), block[BLOCK - 1]))
            .collect()
    };
    let [one, two] = [0.85, 0.425].map(|wavelength_mm| wandering(wavelength_mm, OF_THREADS));
    let there = at_block_ends(&one, |t| 500.0 + 80.0 * t);
    let back = at_block_ends(&one, |t| 660.0 - 80.0 * (t + 4e-4));
    let same = there.iter().flat_map(|&(x, value)| {
        back.iter()
            .filter(move |(other, _)| (x - other).abs() < 1e-6)
            .map(move |&(_, other)| value - other)
    });
    let (mut compared, mut worst) = (0, 0.0f64);
    for off in same {
        (compared, worst) = (compared + 1, worst.max(off.abs()));
    }
    assert!(compared > 900 && worst < 1e-5, "{compared}, {worst}");
    // sin² 2φ = 4 sin² φ (1 - sin² φ).
    let harmonic = at_block_ends(&two, |t| 500.0 + 80.0 * t);
    for ((_, first), (_, second)) in there.iter().zip(&harmonic) {
        let expected = 4.0 * first * first * (1.0 - first * first);
        assert!((second * second - expected).abs() < 1e-4);
    }
}

/// The amplitude is that of a steady line. The phase relative to the same line without wander has the RMS that the
/// wander states.
#[test]
fn a_wandering_line_keeps_its_amplitude_while_its_phase_wanders() {
    let bytes = wandering(0.85, OF_THREADS);
    let speed = 85.0;
    let samples = played(only_texture(&bytes), 40.0, |t| 85.0 * t);
    // Means over 20 ms, two periods, relative to the steady phase.
    let phasors: Vec<[f64; 2]> = samples[BLOCK..]
        .chunks_exact(100)
        .enumerate()
        .map(|(chunk, samples)| {
            samples
                .iter()
                .enumerate()
                .map(|(n, sample)| {
                    let turns = speed / 0.85 * (BLOCK + 100 * chunk + n) as f64 / RATE;
                    [(TAU * turns).sin() * sample, (TAU * turns).cos() * sample]
                })
                .fold([0.0; 2], |[a, b], [c, d]| [a + c / 50.0, b + d / 50.0])
        })
        .collect();
    let lengths: Vec<f64> = phasors.iter().map(|[a, b]| a.hypot(*b)).collect();
    assert!(lengths.iter().all(|length| (length - 1.0).abs() < 0.2));
    let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
    assert!((mean - 1.0).abs() < 0.03, "{mean}");
    let cosine = phasors.iter().map(|[a, b]| a / a.hypot(*b)).sum::<f64>() / lengths.len() as f64;
    // E cos φ = exp(-σ²/2), with σ = 2π · 0.2 / 0.85.
    let expected = (-0.5 * (TAU * 0.2 / 0.85f64).powi(2)).exp();
    assert!((cosine - expected).abs() < 0.1, "{cosine}, not {expected}");
}

#[test]
fn a_line_that_a_clock_moves_holds_its_frequency_at_any_speed_of_the_hand() {
    let wander = Wander {
        rms_mm: 0.0,
        correlation_mm: 1.0,
        clock_mm_s: 100.0,
    };
    let bytes = wandering(0.5, wander);
    for (seconds, position_mm) in [(2.0, (|t| 30.0 * t) as fn(f64) -> f64), (2.0, |t| 250.0 * t)] {
        let samples = played(only_texture(&bytes), seconds, position_mm);
        let is_rise = |pair: &&[f64]| pair[0] < 0.0 && pair[1] >= 0.0;
        let rises = samples.windows(2).filter(is_rise).count();
        assert!(rises.abs_diff(400) <= 1, "{rises}");
    }
}

fn level_db(window: &[f64]) -> f64 {
    let square: f64 = window.iter().map(|x| x * x).sum();
    10.0 * (2.0 * square / window.len() as f64).log10()
}

#[test]
fn a_tool_that_rests_or_lifts_is_silent_without_a_constant_output() {
    let bytes = silent_but_for(&[(0.61, 0.1, 1.0), (50.0, 0.9, 3.0)]);
    // The tool stops at a place at which neither line is zero.
    let samples = played(only_texture(&bytes), 2.0, |t| 80.0 * t.min(1.0013));
    let rest = samples.iter().rposition(|&sample| sample != 0.0).expect("it moved");
    let stops = (1.0013 * RATE) as usize;
    assert!(
        (stops..=stops + 2 * BLOCK).contains(&rest),
        "{rest}, and it stops at {stops}"
    );
    let mut lifted: Synthesis<'_> = Synthesis::new(only_texture(&bytes), 1);
    block(&mut lifted, motion(80.0, 1.0), None);
    let last = block(&mut lifted, motion(80.0, 0.0), None)[BLOCK - 1];
    assert_eq!(last, 0.0);
}

/// Peak of a line at each speed, from its RMS, as a fraction of its amplitude.
#[test]
fn a_line_fades_from_0_40_of_the_sample_rate_and_is_silent_from_0_44_on() {
    let wavelength_mm = 0.05;
    let bytes = silent_but_for(&[(wavelength_mm, 0.0, 1.0)]);
    let mut before = 2.0;
    for hundredths in [
        30.0, 39.9, 40.5, 41.0, 42.0, 43.0, 43.9, 44.0, 44.1, 50.0, 70.0, 99.0, 100.0, 250.0,
    ] {
        let share: f64 = hundredths / 100.0;
        let speed = share * RATE * f64::from(wavelength_mm);
        let samples = played(only_texture(&bytes), 0.5, |t| speed * t);
        let peak = 10f64.powf(level_db(&samples[2 * BLOCK..]) / 20.0);
        let expected = ((0.44 - share) / 0.04).clamp(0.0, 1.0);
        assert!((peak - expected).abs() < 0.01, "{share}: {peak}, not {expected}");
        assert!(peak <= before + 1e-3);
        if share >= 0.4401 {
            assert!(samples.iter().all(|&sample| sample == 0.0), "{share}");
        }
        before = peak;
    }
}

/// No two neighbouring samples differ by more than the line's own slope and the ramp of a block.
fn never_clicks(samples: &[f64], frequency_hz: f64) {
    let steepest = TAU * frequency_hz / RATE + 1.0 / f64::from(UPDATE_INTERVAL_SAMPLES);
    for (n, pair) in samples.windows(2).enumerate() {
        let step = (pair[1] - pair[0]).abs();
        assert!(step < 1.02 * steepest, "sample {n}: {step}, at most {steepest}");
    }
}

#[test]
fn a_jump_of_the_position_does_not_click_and_the_line_goes_on_at_the_new_place() {
    let wavelength_mm = 0.61f32;
    let bytes = silent_but_for(&[(wavelength_mm, 0.0, 1.0)]);
    for jump_mm in [-1000.0, -3.3, 0.8, 1.17, 40.0, 1.0e9] {
        let jump = |t: f64| if t > 0.5021 { jump_mm } else { 0.0 };
        let smooth = |t: f64| 120.0 * t;
        let mut synthesis: Synthesis<'_> = Synthesis::new(only_texture(&bytes), 1);
        let mut samples = Vec::new();
        for number in 0..500 {
            let [_, end] = times(number);
            let position = Position::from_exact_mm(smooth(end) + jump(end));
            samples.extend(block(&mut synthesis, motion(120.0, 1.0), Some(position)));
        }
        never_clicks(&samples[BLOCK..], 120.0 / f64::from(wavelength_mm));
        // Two blocks later the output is the sine of the new place.
        for (n, sample) in samples.iter().enumerate().skip((252 + 2) * BLOCK) {
            let t = n as f64 / RATE;
            let exact = (TAU * (smooth(t) + jump(t)) / f64::from(wavelength_mm)).sin();
            let tolerance = 1e-3 + jump_mm.abs() * 1e-10;
            assert!((sample - exact).abs() < tolerance, "{jump_mm} mm: sample {n}");
        }
    }
}

#[test]
fn blocks_that_are_cut_short_do_not_click() {
    let bytes = silent_but_for(&[(0.61, 0.0, 1.0)]);
    let mut synthesis: Synthesis<'_> = Synthesis::new(only_texture(&bytes), 1);
    let mut samples = Vec::new();
    for block in 0..2000usize {
        let elsewhere = if block.is_multiple_of(97) { 30.0 } else { 0.0 };
        let position = Position::from_exact_mm(0.02 * samples.len() as f64 + 0.2 + elsewhere);
        synthesis.follow_to(motion(100.0, 1.0), Some(position), UPDATE_INTERVAL_SAMPLES);
        let length = 1 + block * 7 % BLOCK;
        samples.extend((0..length).map(|_| m_s2(synthesis.next_sample())));
    }
    // Blocks that end early let the phase catch up at frequencies up to the highest that a line has.
    never_clicks(&samples, 0.44 * RATE);
}

#[test]
fn amplitudes_are_means_over_the_grid_with_the_textures_fade_below_it() {
    for (fade, at_half) in [(FadeLaw::Amplitude, 0.5f64), (FadeLaw::Power, 0.5f64.sqrt())] {
        let silent = vec![NodeSpec::silent(); 4];
        let mut spec = spec(&[40.0, 80.0], &[1.0, 2.0], silent);
        spec.laws.fade = fade;
        let amplitudes = vec![1.0, 2.0, 4.0, 8.0];
        spec.parts.lines = Some(line_of(0.61, amplitudes));
        let bytes = encode(&[spec]).expect("a valid library");
        for (speed, force, amplitude) in [
            (40.0, 1.0, 1.0),
            (40.0, 2.0, 2.0),
            (80.0, 1.5, 6.0),
            (60.0, 1.0, 2.5),
            (60.0, 1.5, 3.75),
            (200.0, 9.0, 8.0),
            (20.0, 1.0, at_half),
            (20.0, 0.5, at_half * at_half),
        ] {
            let mut synthesis: Synthesis<'_> = Synthesis::new(only_texture(&bytes), 1);
            let blocks = 0..2 * SAMPLE_RATE_HZ / UPDATE_INTERVAL_SAMPLES;
            let samples: Vec<f64> = blocks
                .flat_map(|_| block(&mut synthesis, motion(speed, force), None))
                .collect();
            let peak = samples[BLOCK..].iter();
            let peak = peak.fold(0.0f64, |peak, x| peak.max(x.abs()));
            assert!(
                (peak / amplitude - 1.0).abs() < 0.01,
                "{speed}, {force}: {peak}, not {amplitude}"
            );
        }
    }
}

/// The texture's own output and the lines are independent of each other.
#[test]
fn lines_are_added_to_what_the_texture_plays_without_them_bit_for_bit() {
    let node = fixture("H1b").node(4.0);
    let plain = spec(&[10.0], &[0.5], vec![node]);
    let mut lined = plain.clone();
    let alone = silent_but_for(&[(0.61, 0.25, 1.5), (2.0, 0.0, 0.5)]);
    lined.parts.lines = only_texture(&alone).lines().map(Into::into);
    let [plain, lined] = [plain, lined].map(|spec| encode(&[spec]).expect("valid"));
    let samples = |bytes: &[u8]| {
        let mut synthesis: Synthesis<'_> = Synthesis::new(only_texture(bytes), 7);
        let mut samples = Vec::new();
        for block in 0..300u32 {
            synthesis.follow(motion(20.0 + block as f32, 1.0), UPDATE_INTERVAL_SAMPLES);
            samples.extend((0..BLOCK).map(|_| synthesis.next_sample()));
        }
        (samples, synthesis.saturations())
    };
    let [plain, lined, alone] = [plain, lined, alone].map(|bytes| samples(&bytes));
    assert_eq!((plain.1, lined.1), (0, 0));
    for ((plain, lined), alone) in plain.0.iter().zip(&lined.0).zip(&alone.0) {
        assert_eq!(plain.0 + alone.0, lined.0);
    }
}

#[test]
fn a_scene_of_one_surface_plays_its_textures_lines_and_only_then_has_a_stage_for_them() {
    let lined = silent_but_for(&[(0.61, 0.25, 1.5), (2.0, 0.0, 0.5)]);
    let texture = only_texture(&lined);
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture, 3);
    let mut player: ScenePlayer<'_> = ScenePlayer::new(Plan::of_texture(texture), 3);
    for block in 0..400u32 {
        let speed = if block < 300 { 30.0 + block as f32 } else { 0.0 };
        let position = Position::from_exact_mm(0.3 * f64::from(block));
        let told = block.is_multiple_of(3).then_some(position);
        let motion = motion(speed, 1.0);
        synthesis.follow_to(motion, told, UPDATE_INTERVAL_SAMPLES);
        player.follow(Interaction::touching(motion).reaching(told), UPDATE_INTERVAL_SAMPLES);
        let stages = player.block().stages();
        assert_eq!(
            stages.iter().filter(|stage| matches!(stage, Stage::Lines(_))).count(),
            1
        );
        for _ in 0..BLOCK {
            assert_eq!(player.next_sample(), synthesis.next_sample());
        }
    }
    // In the air neither voice nor lines are played.
    for _ in 0..2 {
        player.follow(Interaction::NONE, UPDATE_INTERVAL_SAMPLES);
        (0..BLOCK).for_each(|_| _ = player.next_sample());
    }
    assert!(player.block().stages().is_empty());
    let plain = spec(&[10.0], &[0.5], vec![fixture("H1b").node(1.0)]);
    let plain = encode(&[plain]).expect("valid");
    let mut player: ScenePlayer<'_> = ScenePlayer::new(Plan::of_texture(only_texture(&plain)), 3);
    player.follow(Interaction::touching(motion(80.0, 1.0)), UPDATE_INTERVAL_SAMPLES);
    assert!(matches!(player.block().stages(), [Stage::Voice(_)]));
}

/// Two surfaces with lines: each line has the weight of its surface across the transition, and the surface's gain.
#[test]
fn lines_of_two_surfaces_share_a_transition_and_have_the_gain_of_their_surface() {
    let silent = || vec![NodeSpec::silent()];
    let lined = |name: &str, wavelength_mm| {
        let mut spec = spec(&[10.0], &[0.5], silent());
        spec.name = name.to_owned();
        spec.parts.lines = Some(line_of(wavelength_mm, vec![1.0]));
        spec
    };
    let mut scene = side_by_side(&[0, 1], 40.0);
    scene.surfaces[1].gain = 0.5;
    let bytes = encode_with_scenes(&[lined("one", 0.61), lined("other", 1.9)], &[scene.clone()]).expect("valid");
    let library = Library::decode(&bytes).expect("valid");
    let plan = Plan::new(&scene, &library).expect("valid");
    let cost = plan.worst_case();
    for surface in [0, 1] {
        let item = Item::Lines { surface };
        assert!(cost.terms().iter().any(|term| term.item == item));
    }
    let mut player: ScenePlayer<'_> = ScenePlayer::new(plan, 3);
    let mut samples = Vec::new();
    let x = |t: f64| 40.0 + 60.0 * t;
    for number in 0..1000 {
        let [begin, end] = times(number);
        let told = Position::from_exact_mm(x(end));
        let interaction = Interaction::new(motion(60.0, 1.0), x(begin) as f32, true).expect("finite");
        player.follow(interaction.reaching(Some(told)), UPDATE_INTERVAL_SAMPLES);
        samples.extend((0..BLOCK).map(|_| m_s2(player.next_sample())));
    }
    // Weights are sine and cosine over the transition. The position that selects regions is that of the block's
    // beginning.
    for (n, sample) in samples.iter().enumerate().skip(2 * BLOCK) {
        let t = n as f64 / RATE;
        let share = ((x(t) - 80.0) / 40.0).clamp(0.0, 1.0) * TAU / 4.0;
        let exact = share.cos() * (TAU * x(t) / f64::from(0.61f32)).sin()
            + 0.5 * share.sin() * (TAU * x(t) / f64::from(1.9f32)).sin();
        assert!((sample - exact).abs() < 0.01, "{} mm: {sample}, not {exact}", x(t));
    }
}
