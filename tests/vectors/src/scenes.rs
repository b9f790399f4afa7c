//! Scenes of a library's textures, and their effects.

use model_format::SAMPLE_RATE_HZ;
use model_format::scene::{Biquad, Region, Scene, SceneName, StickSlip, Surface, Tap};

/// `surface` with a tap that rings for seconds.
pub fn tapped(mut surface: Surface) -> Surface {
    let tap = Tap {
        frequency_hz: 300.0,
        decay_s: 1.0,
        gain_m_s2_per_n_s: 0.05,
        limit_m_s2: 20.0,
    };
    surface.tap = Some(tap);
    surface
}

/// `surface` with stick-slip at every speed at which a hand moves.
pub fn sticky(mut surface: Surface) -> Surface {
    let stick_slip = StickSlip {
        period_mm: 1.5,
        duty: 0.6,
        depth: 0.9,
        below_mm_s: 1_000.0,
        above_n: 0.05,
    };
    surface.stick_slip = Some(stick_slip);
    surface
}

/// A scene of one surface, at 5 kHz.
///
/// # Panics
/// The name is too long.
pub fn of_surface(name: &str, surface: Surface) -> Scene {
    let name = SceneName::try_from(name).expect("it is short");
    Scene::of_surface(name, SAMPLE_RATE_HZ, surface)
}

/// A scene of two surfaces side by side: `first` from the first to the second of `ends_mm`, `second` from there to the
/// third.
///
/// # Panics
/// The name is too long.
pub fn side_by_side(name: &str, [first, second]: [Surface; 2], ends_mm: [f32; 3], transition_mm: f32) -> Scene {
    let mut scene = of_surface(name, first);
    scene.transition_mm = transition_mm;
    scene.surfaces.push(second).expect("there is room");
    for (surface, ends) in (0..).zip(ends_mm.windows(2)) {
        let region = Region {
            start_mm: ends[0],
            end_mm: ends[1],
            surface,
        };
        scene.regions.push(region).expect("there is room");
    }
    scene
}

/// A scene of textures 1 and 0 of a library of this sample rate, side by side. The first surface has all effects.
pub fn with_all_effects(sample_rate_hz: u32) -> Scene {
    let with_effects = Surface {
        tap: Some(Tap {
            frequency_hz: 120.0,
            decay_s: 0.03,
            gain_m_s2_per_n_s: 0.5,
            limit_m_s2: 20.0,
        }),
        stick_slip: Some(StickSlip {
            period_mm: 2.0,
            duty: 0.3,
            depth: 0.9,
            below_mm_s: 80.0,
            above_n: 0.8,
        }),
        ..Surface::of_texture(1)
    };
    let surfaces = [with_effects, Surface::of_texture(0)];
    Scene {
        sample_rate_hz,
        ..side_by_side("two", surfaces, [-40.0, 0.0, 40.0], 6.0)
    }
}

/// `scene` with this number of different sections in its equaliser.
///
/// # Panics
/// There are more sections than a scene can hold.
pub fn equalised(mut scene: Scene, sections: usize) -> Scene {
    for section in 0..sections {
        let pole = 0.3 + 0.05 * section as f64;
        let biquad = Biquad::from_f64([0.8, -0.2, 0.1], [-pole, 0.2]).expect("within range");
        scene.equaliser.push(biquad).expect("there is room");
    }
    scene
}
