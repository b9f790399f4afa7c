//! A library and motions that the tests of this folder share.

use model_format::{
    CodeSpec, Library, MillimetresPerSecond, Newton, NodeFlags, NodeSpec, Texture, TextureSpec,
    encode,
};

use crate::playing::motion::MotionPath;

/// A grid of two speeds by two forces whose nodes differ in level and in colour.
pub fn library(sample_rate_hz: u32) -> Vec<u8> {
    let node = |output_power: f32, codes: &[i16]| NodeSpec {
        output_power,
        prediction_error_power: output_power / 2.0,
        flags: NodeFlags::NONE,
        codes: CodeSpec::lattice(codes.to_vec()),
    };
    let texture = TextureSpec {
        sample_rate_hz,
        ..TextureSpec::new(
            "test",
            &[50.0, 100.0],
            &[0.5, 1.0],
            vec![
                node(1.0, &[9000, -20_000]),
                node(4.0, &[3000]),
                node(9.0, &[]),
                node(16.0, &[-9000, 500, 20_000]),
            ],
        )
    };
    encode(&[texture]).unwrap()
}

pub fn texture(library: &[u8]) -> Texture<'_> {
    Library::decode(library).unwrap().texture("test").unwrap()
}

pub fn constant(speed_mm_s: f32, force_n: f32) -> MotionPath {
    MotionPath::constant(MillimetresPerSecond(speed_mm_s), Newton(force_n)).unwrap()
}

/// A motion across the whole grid and down to rest.
pub fn sweep() -> MotionPath {
    let file = tempfile::NamedTempFile::new().unwrap();
    let rows = "time_s,speed_mm_s,force_n\n0,0,0.2\n0.2,120,1.1\n0.3,60,0.4\n0.4,0,0\n";
    std::fs::write(file.path(), rows).unwrap();
    MotionPath::from_csv(file.path()).unwrap()
}
