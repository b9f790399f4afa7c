//! Reading of a scene's record. Fields are read in the order in which postcard writes [`Scene`].

use heapless::Vec;

use super::{Biquad, MotionOfScene, Region, Scene, SceneName, StickSlip, Surface, Tap};
use crate::wire::Reader;

impl Scene {
    /// Reads the scene whose record is `bytes`. Returns none if they are not exactly one scene.
    pub(crate) fn parse(bytes: &[u8]) -> Option<Self> {
        let reader = &mut Reader(bytes);
        let scene = Self {
            name: SceneName::try_from(core::str::from_utf8(reader.string()?).ok()?).ok()?,
            sample_rate_hz: reader.varint()?,
            surfaces: vec(reader, surface)?,
            regions: vec(reader, region)?,
            transition_mm: reader.f32()?,
            motion: match reader.varint()? {
                0 => MotionOfScene::Followed,
                1 => MotionOfScene::Constant {
                    speed_mm_s: reader.f32()?,
                    force_n: reader.f32()?,
                },
                _ => return None,
            },
            equaliser: vec(reader, biquad)?,
        };
        reader.0.is_empty().then_some(scene)
    }

    /// Name of the scene whose record is `bytes`, without parsing more.
    pub(crate) fn name_of(bytes: &[u8]) -> Option<&[u8]> {
        Reader(bytes).string()
    }
}

/// Reads a varint, the number of items, at most `N`, and then the items.
fn vec<'a, T, const N: usize>(reader: &mut Reader<'a>, item: fn(&mut Reader<'a>) -> Option<T>) -> Option<Vec<T, N>> {
    // The stated number is not trusted: the first item without room ends the reading.
    let mut items = Vec::new();
    for _ in 0..reader.varint()? {
        items.push(item(reader)?).ok()?;
    }
    Some(items)
}

fn surface(reader: &mut Reader<'_>) -> Option<Surface> {
    Some(Surface {
        texture: if reader.is_some()? { Some(reader.byte()?) } else { None },
        gain: reader.f32()?,
        tap: if reader.is_some()? { Some(tap(reader)?) } else { None },
        stick_slip: if reader.is_some()? {
            Some(stick_slip(reader)?)
        } else {
            None
        },
    })
}

fn tap(reader: &mut Reader<'_>) -> Option<Tap> {
    Some(Tap {
        frequency_hz: reader.f32()?,
        decay_s: reader.f32()?,
        gain_m_s2_per_n_s: reader.f32()?,
        limit_m_s2: reader.f32()?,
    })
}

fn stick_slip(reader: &mut Reader<'_>) -> Option<StickSlip> {
    Some(StickSlip {
        period_mm: reader.f32()?,
        duty: reader.f32()?,
        depth: reader.f32()?,
        below_mm_s: reader.f32()?,
        above_n: reader.f32()?,
    })
}

fn region(reader: &mut Reader<'_>) -> Option<Region> {
    Some(Region {
        start_mm: reader.f32()?,
        end_mm: reader.f32()?,
        surface: reader.byte()?,
    })
}

fn biquad(reader: &mut Reader<'_>) -> Option<Biquad> {
    let mut steps = || {
        let zigzag = reader.varint()?;
        Some((zigzag >> 1).cast_signed() ^ -(zigzag & 1).cast_signed())
    };
    Some(Biquad {
        numerator: [steps()?, steps()?, steps()?],
        denominator: [steps()?, steps()?],
    })
}
