//! Round trips: from content to bytes and back, and from bytes to content and back.

use model_format::{
    BLOCK_BYTES, CodeSpec, CodebookSpec, ExcitationSpec, FadeLaw, Laws, LevelLaw, Library, LineSpec, LinesSpec,
    MAX_FINE_THETA, NodeFlags, NodeSpec, PartsSpec, Provenance, TailSpec, TextureSpec, Wander, encode,
    encode_with_scenes, limits,
};
use proptest::collection::{btree_set, vec};
use proptest::prelude::*;

use crate::bytes::RawLibrary;
use crate::walk::{content, scenes};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn what_is_encoded_decodes_to_the_same_and_encodes_to_the_same_bytes(textures in library()) {
        let bytes = encode(&textures).expect("the strategy makes valid libraries");
        let read = content(&Library::decode(&bytes).expect("encode checks what it gives"));
        prop_assert_eq!(&read, &textures);
        prop_assert_eq!(encode(&read).expect("it was read from a library"), bytes);
    }
}

/// The encoder and the tests' own writer, which share no code, agree on every byte, of parts and scenes too.
#[test]
fn two_independent_writers_give_the_same_bytes() {
    for (raw, count) in [(RawLibrary::sound(), 0), (RawLibrary::full(), 2)] {
        let bytes = raw.bytes();
        let library = Library::decode(&bytes).expect("a valid library");
        let (textures, scenes) = (content(&library), scenes(&library));
        assert_eq!(scenes.len(), count);
        let again = encode_with_scenes(&textures, &scenes).expect("valid content");
        assert_eq!(again, bytes);
    }
}

proptest! {
    /// A tail has the smallest possible step, so that the encoder accepts it, and no θ is off by more than half a step.
    #[test]
    fn a_compact_lattice_is_as_near_as_its_bytes_allow(
        thetas in vec(prop_oneof![-MAX_FINE_THETA..=MAX_FINE_THETA, -40_000..=40_000i32, -200..=200i32], 0..=400),
        scale in 0u32..24,
        fine in 0..=limits::MAX_FINE_STAGES,
    ) {
        let thetas: Vec<i32> = thetas.iter().map(|theta| theta >> scale).collect();
        let codes = CodeSpec::compact_lattice(&thetas, fine);
        let CodeSpec { tail, fractions, .. } = &codes;
        prop_assert!(fractions.len() <= fine);
        let stored: Vec<i32> = codes.thetas().collect();
        prop_assert_eq!(stored.len(), thetas.len());
        for (stage, (&stored, &theta)) in stored.iter().zip(&thetas).enumerate() {
            let bound = match stage {
                _ if stage < fine => 0,
                0..limits::MAX_FINE_STAGES => 128,
                // The largest θ of a lattice is a little larger than the largest θ that a tail can hold.
                _ => i32::from(tail.step) / 2 + (theta.abs() - TailSpec::MAX_THETA).max(0),
            };
            prop_assert!((stored - theta).abs() <= bound, "stage {}: {} for {}", stage + 1, stored, theta);
        }
        let texture = TextureSpec::new("one", &[100.0], &[1.0], vec![NodeSpec::new(1.0, codes)]);
        let bytes = encode(&[texture]).expect("it is valid");
        let library = Library::decode(&bytes).expect("it was encoded");
        let texture = library.textures().next().expect("one was encoded");
        prop_assert_eq!(texture.has_tails(), thetas.len() > limits::MAX_FINE_STAGES);
        prop_assert!(texture.node(0, 0).coefficients.thetas().eq(stored));
    }
}

fn library() -> impl Strategy<Value = Vec<TextureSpec>> {
    vec(texture(), 1..=3).prop_map(|mut textures| {
        for (index, texture) in textures.iter_mut().enumerate() {
            // Random names are rarely equal, but they may be.
            texture.name.insert_str(0, &index.to_string());
        }
        textures
    })
}

fn texture() -> impl Strategy<Value = TextureSpec> {
    let laws = (
        prop::sample::select(&LevelLaw::ALL[..]),
        prop::sample::select(&FadeLaw::ALL[..]),
    );
    (axis(), axis(), laws).prop_flat_map(|(speeds, forces, laws)| {
        let at_zero = |index: usize| {
            let (speed, force) = (index / forces.len(), index % forces.len());
            speeds[speed] <= 0.0 || forces[force] <= 0.0
        };
        let nodes: Vec<_> = (0..speeds.len() * forces.len())
            .map(|index| node(at_zero(index)))
            .collect();
        let nodes_that_move: Vec<bool> = (0..speeds.len() * forces.len()).map(|index| !at_zero(index)).collect();
        (
            name(),
            1..=limits::MAX_SAMPLE_RATE_HZ,
            prop_oneof![
                Just(Provenance::Recorded),
                Just(Provenance::Simulated),
                Just(Provenance::Unscaled)
            ],
            (nodes, any::<bool>()),
            parts(speeds.len() * forces.len()),
            lines(nodes_that_move),
        )
            .prop_map(
                move |(name, sample_rate_hz, provenance, (nodes, tails), parts, lines)| TextureSpec {
                    laws: laws_for(laws, &nodes),
                    nodes: if tails { with_tails(nodes) } else { nodes },
                    parts: PartsSpec { lines, ..parts },
                    name,
                    sample_rate_hz,
                    provenance,
                    speed_axis_mm_s: speeds.clone(),
                    force_axis_n: forces.clone(),
                },
            )
    })
}

/// `nodes` with tails: the first codes keep their 16 bits, the others become bytes, and the step is one that these
/// bytes allow.
fn with_tails(mut nodes: Vec<NodeSpec>) -> Vec<NodeSpec> {
    for node in &mut nodes {
        let CodeSpec { codes, tail, .. } = &mut node.codes;
        let further = codes.split_off(codes.len().min(limits::MAX_FINE_STAGES));
        tail.codes = further
            .iter()
            .map(|code| (*code as i8).max(-TailSpec::MAX_CODE))
            .collect();
        let largest = tail.codes.iter().map(|code| code.unsigned_abs()).max();
        tail.step = match largest.unwrap_or(0) {
            0 => 0,
            1..limits::MIN_LARGEST_TAIL_CODE => 1,
            _ => codes[0].cast_unsigned().max(1),
        };
    }
    nodes
}

/// Codebooks for `nodes` nodes, or none.
fn parts(nodes: usize) -> impl Strategy<Value = PartsSpec> {
    let count = 1..=limits::MAX_CODEBOOKS.min(nodes);
    let codebooks = vec(codebook(), count);
    let excitation = (codebooks, vec(0..=limits::MAX_CODEBOOKS as u8, nodes)).prop_map(|(codebooks, mut of_nodes)| {
        for source in &mut of_nodes {
            *source %= codebooks.len() as u8 + 1;
        }
        for (number, source) in (1..=codebooks.len()).zip(&mut of_nodes) {
            *source = number as u8;
        }
        ExcitationSpec { codebooks, of_nodes }
    });
    prop::option::weighted(0.3, excitation).prop_map(|excitation| PartsSpec {
        excitation,
        lines: None,
    })
}

/// A codebook with a mean square of 1. The second half of each block is the first half negated.
fn codebook() -> impl Strategy<Value = CodebookSpec> {
    let block = (vec(any::<u8>(), 12), -100..=0i8);
    vec(block, 16..60).prop_map(|blocks| {
        let bytes = blocks.into_iter().flat_map(|(half, level)| {
            // The third bit of each code of three bits.
            let minus = [0x24, 0x49, 0x92].into_iter().cycle();
            let negated: Vec<u8> = half.iter().zip(minus).map(|(codes, minus)| codes ^ minus).collect();
            [half, negated, vec![level.cast_unsigned()]].concat()
        });
        let mut bytes: Vec<u8> = bytes.collect();
        // One block is at the peak, so that the peak that gives a mean square of 1 stays within its bound.
        bytes[BLOCK_BYTES - 1] = 0;
        CodebookSpec::of_unit_power(bytes)
    })
}

/// The laws `level` and `fade`. If a node is silent, another law replaces `Logarithm`.
fn laws_for((level, fade): (LevelLaw, FadeLaw), nodes: &[NodeSpec]) -> Laws {
    let level = match level {
        LevelLaw::Logarithm if nodes.iter().any(|node| node.output_power <= 0.0) => LevelLaw::Power,
        level => level,
    };
    Laws { level, fade }
}

/// Lines with amplitudes above 0 only at the nodes for which `moves` is true; none if it is true for no node.
fn lines(moves: Vec<bool>) -> impl Strategy<Value = Option<LinesSpec>> {
    let some = moves.iter().any(|&moves| moves);
    let wavelengths = limits::MIN_WAVELENGTH_MM.to_bits()..=limits::MAX_WAVELENGTH_MM.to_bits();
    let amplitude = 1..=limits::MAX_LINE_AMPLITUDE.to_bits();
    let amplitudes = vec(amplitude, moves.len() * limits::MAX_LINES);
    let phases = vec(any::<u16>(), limits::MAX_LINES);
    let wavelengths = btree_set(wavelengths, 0..=limits::MAX_LINES);
    (wavelengths, phases, amplitudes).prop_map(move |(wavelengths, phases, amplitudes)| {
        let amplitudes = amplitudes.chunks(moves.len());
        let lines: Vec<LineSpec> = wavelengths
            .iter()
            .zip(&phases)
            .zip(amplitudes)
            .map(|((&wavelength, &phase), amplitudes)| LineSpec {
                wavelength_mm: f32::from_bits(wavelength),
                phase,
                amplitudes: amplitudes
                    .iter()
                    .zip(&moves)
                    .map(|(&bits, &moves)| if moves { f32::from_bits(bits) } else { 0.0 })
                    .collect(),
                ..LineSpec::default()
            })
            .collect();
        (some && !lines.is_empty()).then(|| wandering(lines))
    })
}

/// `lines`, of which every other line has a wander. With enough lines, both kinds of wander occur.
fn wandering(mut lines: Vec<LineSpec>) -> LinesSpec {
    let all = [(0.02, 0.5, 0.0), (0.0, limits::MAX_CORRELATION_MM, 70.0)];
    let wander = |(rms_mm, correlation_mm, clock_mm_s)| Wander {
        rms_mm,
        correlation_mm,
        clock_mm_s,
    };
    let count = (lines.len() / 2).min(all.len());
    for (index, line) in lines.iter_mut().skip(1).step_by(2).enumerate() {
        line.wander = Some((index % count) as u8);
    }
    LinesSpec {
        lines,
        wanders: all[..count].iter().copied().map(wander).collect(),
    }
}

/// A name of up to 40 bytes, so that an index fits before it.
fn name() -> impl Strategy<Value = String> {
    "\\PC{1,10}".prop_filter("no control character", |name| !name.chars().any(char::is_control))
}

/// Finite values that are not negative, including zero, the smallest and the largest. Such values have the same order
/// as their bits.
fn axis() -> impl Strategy<Value = Vec<f32>> {
    let bits = prop_oneof![
        4 => 0..=f32::MAX.to_bits(),
        1 => Just(0),
        1 => Just(1),
        1 => Just(f32::MAX.to_bits()),
    ];
    btree_set(bits, 1..=4).prop_map(|bits| bits.into_iter().map(f32::from_bits).collect())
}

fn node(at_zero: bool) -> impl Strategy<Value = NodeSpec> {
    let orders = prop_oneof![2 => Just(0), 6 => 1usize..20, 1 => Just(limits::MAX_ORDER)];
    let codes = orders.prop_flat_map(codes);
    let powers = (
        0..=limits::MAX_OUTPUT_POWER.to_bits(),
        0.0f32..=1.0,
        prop::bool::weighted(0.2),
    );
    (codes, powers, 0u8..8).prop_map(move |(codes, (output, share, silent), origin)| {
        let output_power = if silent || at_zero { 0.0 } else { f32::from_bits(output) };
        let mut flags = NodeFlags::NONE;
        for (bit, flag) in [NodeFlags::INTERPOLATED, NodeFlags::EXTRAPOLATED, NodeFlags::DOUBTFUL]
            .into_iter()
            .enumerate()
        {
            if origin >> bit & 1 == 1 {
                flags = flags.with(flag);
            }
        }
        if output_power.to_bits() == 0 {
            flags = flags.with(NodeFlags::SILENT);
        }
        NodeSpec {
            output_power,
            prediction_error_power: output_power * share,
            flags,
            codes,
        }
    })
}

fn codes(order: usize) -> impl Strategy<Value = CodeSpec> {
    let fine = prop_oneof![
        Just(Vec::new()),
        vec(any_with_zeros(), 0..=limits::MAX_FINE_STAGES.min(order)),
    ];
    (vec(-i16::MAX..=i16::MAX, order), fine).prop_map(|(codes, mut fractions)| {
        // Zeros at the end have no effect, and reading leaves them out.
        while fractions.pop_if(|fraction| *fraction == 0).is_some() {}
        CodeSpec {
            codes,
            fractions,
            tail: TailSpec::default(),
        }
    })
}

fn any_with_zeros() -> impl Strategy<Value = i8> {
    prop_oneof![Just(0), any::<i8>()]
}
