//! Reads everything that a valid library offers. The fuzz target includes this file too.

use std::iter::repeat;

use model_format::scene::Scene;
use model_format::{
    BLOCK_BYTES, BLOCK_SAMPLES, CodeSpec, CodebookSpec, Coefficients, ExcitationSpec, Library, Lines, LinesSpec,
    NodeFlags, NodeSpec, PartsSpec, TailSpec, Texture, TextureSpec, limits,
};

/// The content of `library`, through its public interface.
/// Panics if the library breaks a promise to the kernel.
pub fn content(library: &Library<'_>) -> Vec<TextureSpec> {
    let mut textures = Vec::new();
    for texture in library.textures() {
        assert_eq!(
            library.texture(texture.name()).map(|found| found.name()),
            Some(texture.name())
        );
        let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
        for axis in [speeds, forces] {
            assert!((1..=limits::MAX_AXIS_LEN).contains(&axis.len()));
            let values: Vec<f32> = (0..axis.len()).map(|index| axis.value(index)).collect();
            assert!(axis.values().eq(values.iter().copied()));
            assert!(values.iter().all(|value| value.is_finite() && *value >= 0.0));
            assert!(values.is_sorted_by(|before, after| before < after));
        }
        let mut nodes = Vec::new();
        for speed in 0..speeds.len() {
            for force in 0..forces.len() {
                let node = texture.node(speed, force);
                let silent = node.output_power.to_bits() == 0;
                assert_eq!(silent, node.flags.contains(NodeFlags::SILENT));
                assert!(silent || speeds.value(speed) > 0.0 && forces.value(force) > 0.0);
                assert!((0.0..=limits::MAX_OUTPUT_POWER).contains(&node.output_power));
                assert!((0.0..=node.output_power).contains(&node.prediction_error_power));
                assert!(node.coefficients.order() <= texture.max_order());
                nodes.push(NodeSpec {
                    output_power: node.output_power,
                    prediction_error_power: node.prediction_error_power,
                    flags: node.flags,
                    codes: codes(node.coefficients),
                });
            }
        }
        assert!(texture.max_order() <= limits::MAX_ORDER);
        assert_eq!(texture.nodes().count(), nodes.len());
        check_tails(&texture, &nodes);
        textures.push(TextureSpec {
            name: texture.name().to_owned(),
            sample_rate_hz: texture.sample_rate_hz(),
            provenance: texture.provenance(),
            laws: texture.laws(),
            parts: parts(&texture),
            speed_axis_mm_s: speeds.values().collect(),
            force_axis_n: forces.values().collect(),
            nodes,
        });
    }
    assert_eq!(textures.len(), library.len());
    textures
}

/// In a texture with tails, all nodes of more than 32 stages have a tail, and there is at least one such node. In other
/// textures, no node has a tail.
fn check_tails(texture: &Texture<'_>, nodes: &[NodeSpec]) {
    let long = |node: &&NodeSpec| node.codes.thetas().count() > limits::MAX_FINE_STAGES;
    for node in nodes.iter().filter(long) {
        assert_eq!(node.codes.tail.codes.is_empty(), !texture.has_tails());
    }
    assert!(!texture.has_tails() || nodes.iter().any(|node| long(&node)));
}

/// The lines of `texture`, with each amplitude read by the indices of its node.
fn lines_of(texture: &Texture<'_>, lines: Lines<'_>) -> LinesSpec {
    let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
    assert!((1..=limits::MAX_LINES).contains(&lines.len()));
    let found = LinesSpec::from(lines);
    for (index, (line, spec)) in lines.iter().zip(&found.lines).enumerate() {
        let wavelength_mm = line.wavelength_mm();
        assert!((limits::MIN_WAVELENGTH_MM..=limits::MAX_WAVELENGTH_MM).contains(&wavelength_mm));
        assert!(
            found.lines[..index]
                .iter()
                .all(|other| other.wavelength_mm.to_bits() != wavelength_mm.to_bits())
        );
        assert_eq!(spec.amplitudes.len(), speeds.len() * forces.len());
        for (node, &amplitude) in spec.amplitudes.iter().enumerate() {
            let (speed, force) = (node / forces.len(), node % forces.len());
            let moves = speeds.value(speed) > 0.0 && forces.value(force) > 0.0;
            assert_eq!(line.amplitude(speed, force).to_bits(), amplitude.to_bits());
            assert!((0.0..=limits::MAX_LINE_AMPLITUDE).contains(&amplitude));
            assert!(moves || amplitude.to_bits() == 0);
        }
        assert!(spec.amplitudes.iter().any(|&amplitude| amplitude > 0.0));
    }
    found
}

/// The optional parts of a texture, after checks of what the format promises about each.
fn parts(texture: &Texture<'_>) -> PartsSpec {
    let (speeds, forces) = (texture.speed_axis().len(), texture.force_axis().len());
    let excitation = texture.excitation().map(|excitation| {
        let nodes = (0..speeds * forces).map(|n| excitation.of_node(n / forces, n % forces) as u8);
        let spec = ExcitationSpec::from(excitation);
        assert!(nodes.eq(spec.of_nodes.iter().copied()));
        spec
    });
    for codebook in excitation.iter().flat_map(|spec| &spec.codebooks) {
        assert!(codebook.peak > 0.0 && codebook.peak <= 40.0);
        assert!((1000..=41_920).contains(&(codebook.blocks.len() / BLOCK_BYTES * BLOCK_SAMPLES)));
        let power = mean_square(codebook);
        assert!((0.975..=1.025).contains(&power), "{power}");
        let mean = samples(codebook).sum::<f64>() / samples(codebook).count() as f64;
        assert!(mean.abs() < 0.031, "{mean}");
    }
    if let Some(spec) = &excitation {
        let named = |number: &u8| usize::from(*number) <= spec.codebooks.len();
        assert!(spec.of_nodes.iter().all(named));
        assert!((1..=spec.codebooks.len()).all(|number| spec.of_nodes.contains(&(number as u8))));
    }
    assert_eq!(texture.is_fed(), excitation.is_some());
    PartsSpec {
        excitation,
        lines: texture.lines().map(|lines| lines_of(texture, lines)),
    }
}

/// Value of a sample of a block as a fraction of the peak, by the format's formula. The code is read bit by bit.
pub fn share_of_block(block: &[u8], index: usize) -> f64 {
    let bit = |at: usize| u32::from(block[at / 8] >> (at % 8) & 1);
    let k = bit(3 * index) + 2 * bit(3 * index + 1);
    let m = (5f64.powf(f64::from(2 * k + 1) / 7.0) - 1.0) / 4.0;
    let scale = 10f64.powf(f64::from(block[24].cast_signed()) / 40.0);
    if bit(3 * index + 2) == 1 { -scale * m } else { scale * m }
}

/// Samples of a codebook by the formula of the format, in floating point.
fn samples(codebook: &CodebookSpec) -> impl Iterator<Item = f64> {
    codebook
        .blocks
        .chunks(BLOCK_BYTES)
        .flat_map(|block| (0..BLOCK_SAMPLES).map(|index| share_of_block(block, index)))
        .map(|share| share * f64::from(codebook.peak))
}

/// Mean square of a codebook.
pub fn mean_square(codebook: &CodebookSpec) -> f64 {
    samples(codebook).map(|x| x * x).sum::<f64>() / samples(codebook).count() as f64
}

/// The scenes of `library`, through its public interface.
/// Panics if a scene breaks a promise to the kernel.
pub fn scenes(library: &Library<'_>) -> Vec<Scene> {
    let scenes: Vec<Scene> = library.scenes().collect();
    assert_eq!(scenes.len(), library.scene_count());
    for scene in &scenes {
        assert_eq!(library.scene(&scene.name).as_ref(), Some(scene));
        assert_eq!(scene.validate(library), Ok(()));
        let is_there = |surface: u8| usize::from(surface) < scene.surfaces.len();
        assert!(scene.regions.iter().all(|region| is_there(region.surface)));
        for surface in &scene.surfaces {
            let Some(texture) = surface.texture else {
                assert!(surface.stick_slip.is_none());
                continue;
            };
            let texture = library.textures().nth(usize::from(texture));
            let loudest = texture.expect("it is there").max_output_power();
            let room = 4.0 * surface.gain * surface.gain * loudest <= limits::MAX_OUTPUT_POWER;
            assert!(surface.gain >= 0.0 && (surface.gain <= 1.0 || room));
        }
    }
    scenes
}

fn codes(coefficients: Coefficients<'_>) -> CodeSpec {
    let mut spec = CodeSpec::from(coefficients);
    let CodeSpec { codes, fractions, tail } = &mut spec;
    assert!(fractions.len() <= limits::MAX_FINE_STAGES.min(codes.len()));
    assert!(!codes.contains(&i16::MIN));
    let all = fractions.iter().copied().chain(repeat(0));
    let theta = |(&code, fraction): (&i16, i8)| i32::from(code) * 256 + i32::from(fraction);
    let thetas = codes.iter().zip(all).map(theta).chain(thetas_of(tail));
    // θ is below π/2 in magnitude, so that a texture is stable at every mean of its nodes.
    assert!(thetas.clone().all(|theta| theta.unsigned_abs() < 1 << 23));
    assert!(coefficients.thetas().eq(thetas));
    check_tail(codes.len(), tail);
    // Zeros at the end have no effect.
    while fractions.pop_if(|fraction| *fraction == 0).is_some() {}
    spec
}

fn thetas_of(tail: &TailSpec) -> impl Iterator<Item = i32> + Clone + '_ {
    let step = i32::from(tail.step);
    tail.codes.iter().map(move |&code| i32::from(code) * step)
}

/// Checks that a tail after `before` stages begins after the first 32 stages and has the step that its codes need.
fn check_tail(before: usize, tail: &TailSpec) {
    assert!(before == limits::MAX_FINE_STAGES || tail.codes.is_empty());
    assert!(!tail.codes.contains(&i8::MIN));
    let largest = tail.codes.iter().map(|code| code.unsigned_abs()).max().unwrap_or(0);
    assert_eq!(tail.step == 0, largest == 0);
    assert!(tail.step <= 1 || largest >= limits::MIN_LARGEST_TAIL_CODE);
}
