//! Lattices under any grid, state, motion per sample and excitation: energy never grows, and nothing overflows.
//!
//! The input is read in order: a byte for the laws and for tails, one byte per order, two bytes per θ (one in a tail,
//! and two for its step), a byte per fraction, four bytes per motion, two bytes per excitation.
use model_format::limits::{MAX_FINE_STAGES, MAX_ORDER, MAX_OUTPUT_POWER, MIN_LARGEST_TAIL_CODE};
use model_format::{
    CodeSpec, FadeLaw, Laws, LevelLaw, Library, MillimetresPerSecond, Newton, NodeSpec, TailSpec,
    TextureSpec, encode,
};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::lattice::{LatticeFrame, LatticeState};
use stylus_kernel::{Levels, Motion};

const SPEEDS_MM_S: [f32; 2] = [50.0, 150.0];
const FORCES_N: [f32; 2] = [0.5, 1.5];

/// Judges `input` as a grid, a state and motions.
pub fn judge(input: &[u8]) {
    let mut bytes = input.iter().copied();
    let library = library(&mut bytes);
    let library = Library::decode(&library).expect("lattices of such codes are valid");
    let texture = library.textures().next().expect("one was encoded");
    let mut frame = LatticeFrame::silent(texture.max_order());
    let stages = texture.max_order();
    let mut state = LatticeState::from_backward(std::array::from_fn(|_| {
        (i32::from(sixteen(&mut bytes)) << 16) | i32::from(sixteen(&mut bytes))
    }));
    while let Some(low) = bytes.next() {
        let excitation = i32::from(sixteen(&mut bytes)) << (low % 17);
        let motion = Motion::new(
            MillimetresPerSecond(f32::from(sixteen(&mut bytes)) / 100.0),
            Newton(f32::from(low) / 100.0),
        );
        let point = GridPoint::locate(&texture, motion.expect("it is finite"));
        frame.update::<Portable>(&texture, &point, Levels::SILENT, 1);
        let before = energy(state.backward(stages)) + energy(&[excitation]);
        state.next_sample::<Portable>(&frame, excitation, 0);
        assert!(energy(state.backward(stages)) <= before);
    }
}

fn sixteen(bytes: &mut impl Iterator<Item = u8>) -> i16 {
    let mut byte = || bytes.next().unwrap_or(0);
    i16::from_le_bytes([byte(), byte()])
}

fn energy(signals: &[i32]) -> u128 {
    let squares = signals
        .iter()
        .map(|&signal| u128::from(signal.unsigned_abs()).pow(2));
    squares.sum()
}

/// A tail of so many stages, whose step is the least or the largest that its codes allow, or between.
fn tail(stages: usize, bytes: &mut impl Iterator<Item = u8>) -> TailSpec {
    let mut code = || bytes.next().unwrap_or(0).cast_signed();
    let codes: Vec<i8> = (0..stages)
        .map(|_| code().max(-TailSpec::MAX_CODE))
        .collect();
    let largest = codes.iter().map(|code| code.unsigned_abs()).max();
    let step = match largest.unwrap_or(0) {
        0 => 0,
        1..MIN_LARGEST_TAIL_CODE => 1,
        _ => sixteen(bytes).cast_unsigned().max(1),
    };
    TailSpec { codes, step }
}

fn library(bytes: &mut impl Iterator<Item = u8>) -> Vec<u8> {
    let choice = usize::from(bytes.next().unwrap_or(0));
    let laws = Laws {
        level: LevelLaw::ALL[choice % LevelLaw::ALL.len()],
        fade: FadeLaw::ALL[choice / LevelLaw::ALL.len() % FadeLaw::ALL.len()],
    };
    let tails = choice >= 128;
    let mut node = |_| {
        let order = usize::from(bytes.next().unwrap_or(0)).min(MAX_ORDER);
        let before = if tails {
            order.min(MAX_FINE_STAGES)
        } else {
            order
        };
        let codes = (0..before).map(|_| sixteen(bytes).max(-i16::MAX)).collect();
        let tail = tail(order - before, bytes);
        let fine = 0..order.min(MAX_FINE_STAGES);
        let fractions = fine
            .map(|_| bytes.next().unwrap_or(0).cast_signed())
            .collect();
        NodeSpec::new(
            MAX_OUTPUT_POWER,
            CodeSpec {
                codes,
                fractions,
                tail,
            },
        )
    };
    let texture = TextureSpec {
        laws,
        ..TextureSpec::new(
            "fuzz",
            &SPEEDS_MM_S,
            &FORCES_N,
            (0..4).map(&mut node).collect(),
        )
    };
    encode(&[texture]).expect("lattices of such codes are valid")
}
