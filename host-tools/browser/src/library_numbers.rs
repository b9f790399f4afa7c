//! Content of a library as lists of numbers, for readers in other languages.

use model_format::scene::{MotionOfScene, Scene};
use model_format::{NodeFlags, Provenance, Texture};

use crate::session::Without;

/// Flags of a node, in the order of their bits.
const FLAGS: [NodeFlags; 4] = [
    NodeFlags::SILENT,
    NodeFlags::INTERPOLATED,
    NodeFlags::EXTRAPOLATED,
    NodeFlags::DOUBTFUL,
];

/// Writes what is stored of `texture` to `numbers`; the package's page has their order.
pub fn texture_numbers(texture: &Texture<'_>, numbers: &mut Vec<f64>) {
    let provenance = match texture.provenance() {
        Provenance::Recorded => 0,
        Provenance::Simulated => 1,
    };
    let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
    numbers.extend([
        f64::from(texture.sample_rate_hz()),
        f64::from(provenance),
        f64::from(Without::possible(texture).bits()),
        speeds.len() as f64,
        forces.len() as f64,
        texture.max_order() as f64,
    ]);
    numbers.extend(speeds.values().map(f64::from));
    numbers.extend(forces.values().map(f64::from));
    for node in texture.nodes() {
        let rms_m_s2 = f64::from(node.output_power).sqrt();
        let flags = FLAGS.iter().zip([1u8, 2, 4, 8]);
        let flags = flags.map(|(&flag, bit)| u8::from(node.flags.contains(flag)) * bit);
        numbers.extend([
            node.coefficients.order() as f64,
            rms_m_s2,
            f64::from(flags.sum::<u8>()),
        ]);
    }
}

/// Writes what is stored of `scene` to `numbers`; the package's page has their order.
pub fn scene_numbers(scene: &Scene, numbers: &mut Vec<f64>) {
    let constant = match scene.motion {
        MotionOfScene::Followed => [0.0, f64::NAN, f64::NAN],
        MotionOfScene::Constant {
            speed_mm_s,
            force_n,
        } => [1.0, f64::from(speed_mm_s), f64::from(force_n)],
    };
    numbers.extend([
        f64::from(scene.sample_rate_hz),
        f64::from(scene.transition_mm),
    ]);
    numbers.extend(constant);
    numbers.extend([
        scene.equaliser.len() as f64,
        scene.surfaces.len() as f64,
        scene.regions.len() as f64,
    ]);
    let or_nan = |value: Option<f32>| value.map_or(f64::NAN, f64::from);
    for surface in &scene.surfaces {
        numbers.extend([
            surface.texture.map_or(-1.0, f64::from),
            f64::from(surface.gain),
            or_nan(surface.tap.map(|tap| tap.frequency_hz)),
            or_nan(surface.stick_slip.map(|slip| slip.period_mm)),
        ]);
    }
    for region in &scene.regions {
        numbers.extend([
            f64::from(region.start_mm),
            f64::from(region.end_mm),
            f64::from(region.surface),
        ]);
    }
}
