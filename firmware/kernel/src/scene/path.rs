//! Surfaces along the path, and their weights in equal-power transitions.

use heapless::Vec;
use model_format::scene::limits::{MAX_REGIONS, MAX_SURFACES};
use model_format::scene::{Region, Scene};

use crate::grid::ONE;
use crate::rotation::{Rotation, THETA_QUARTER_TURN};

/// A surface that sounds at a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Located {
    /// Index of the surface in the scene.
    pub surface: u8,
    /// Factor of its amplitude, in steps of 2⁻¹⁶. The squares of all weights at a position add up to at most 2³².
    /// Within rounding they reach this bound, except near the end of a region without a neighbour.
    pub weight: u32,
}

/// The regions of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    regions: Vec<Region, MAX_REGIONS>,
    transition_mm: f32,
}

impl Path {
    /// The path of a valid scene.
    pub fn new(scene: &Scene) -> Self {
        Self {
            regions: scene.regions.clone(),
            transition_mm: scene.transition_mm,
        }
    }

    /// The path that has the first surface everywhere.
    pub const fn everywhere() -> Self {
        Self {
            regions: Vec::new(),
            transition_mm: 0.0,
        }
    }

    /// Indices of the surfaces that lie on the path, ascending.
    pub fn surfaces(&self) -> impl Iterator<Item = u8> + '_ {
        let count = if self.regions.is_empty() { 1 } else { MAX_SURFACES as u8 };
        (0..count)
            .filter(|&surface| self.regions.is_empty() || self.regions.iter().any(|region| region.surface == surface))
    }

    /// The surfaces at `position_mm`: at most two different ones, first the surface of the region at this position.
    pub fn locate(&self, position_mm: f32) -> Vec<Located, 2> {
        let mut found = Vec::new();
        let mut add = |surface: u8, weight: u32| {
            // There is space for two.
            let _ = found.push(Located { surface, weight });
        };
        if self.regions.is_empty() {
            add(0, ONE);
            return found;
        }
        let here = |region: &Region| (region.start_mm..region.end_mm).contains(&position_mm);
        let Some(index) = self.regions.iter().position(here) else {
            return found;
        };
        let region = &self.regions[index];
        // Regions touch only if their numbers are equal; any gap between them is silent.
        let before = index
            .checked_sub(1)
            .map(|before| &self.regions[before])
            .filter(|before| before.end_mm == region.start_mm);
        let after = self
            .regions
            .get(index + 1)
            .filter(|after| after.start_mm == region.end_mm);
        // Transitions reach at most to the middle of a region, so that a position lies in at most one transition.
        let (from_start, to_end) = (position_mm - region.start_mm, region.end_mm - position_mm);
        let (neighbour, distance) = if from_start <= to_end {
            (before, from_start)
        } else {
            (after, to_end)
        };
        let half = self.half_width(region, neighbour);
        if distance >= half {
            add(region.surface, ONE);
        } else if let Some(neighbour) = neighbour {
            if neighbour.surface == region.surface {
                add(region.surface, ONE);
            } else {
                // From the middle of the transition, where both surfaces have the same power, to its end.
                let (own, other) = weights(0.5 + 0.5 * distance / half);
                add(region.surface, own);
                add(neighbour.surface, other);
            }
        } else {
            add(region.surface, weights(distance / half).0);
        }
        found
    }

    /// Half the width of the transition between `region` and `neighbour`, or from `region` to nothing.
    fn half_width(&self, region: &Region, neighbour: Option<&Region>) -> f32 {
        let length = |region: &Region| region.end_mm - region.start_mm;
        let shortest = neighbour.map_or(length(region), |other| length(other).min(length(region)));
        0.5 * self.transition_mm.min(shortest)
    }
}

/// Weights of the incoming and the outgoing surface at the fraction `share` of a transition: sine and cosine of that
/// fraction of a quarter turn, whose squares add up to at most one in the integers.
fn weights(share: f32) -> (u32, u32) {
    let theta = (share * THETA_QUARTER_TURN as f32) as i32;
    let rotation = Rotation::from_theta(theta);
    ((rotation.sin >> 15) as u32, (rotation.cos >> 15) as u32)
}
