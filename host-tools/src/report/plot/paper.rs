//! The paper's figures 5 and 9 from the user's own recordings.

use plotters::prelude::*;

use super::canvas::{
    ACCELERATION, Axis, BLUE, FORCE, GREEN, INK, Quantity, SPEED, Stroke, Swatch, TIME_MS, Ticks,
    VERMILION, at, axes, highest_of, legend, line, picture, px,
};
use super::figure::{Kind, Series, Third};
use super::{Caption, Svg};
use crate::support::error::Result;

/// The paper's figure 5: a stretch of a recording, its prediction from the samples before, and what is left, m/s², one
/// above the other and to the same scale: up to `peak_m_s2`, where pictures are compared.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn forward_prediction(
    caption: &Caption<'_>,
    recorded: &[f64],
    predicted: &[f64],
    rate_hz: f64,
    peak_m_s2: Option<f64>,
) -> Result<Svg> {
    let residual: Vec<f64> = recorded.iter().zip(predicted).map(|(a, p)| a - p).collect();
    let curves = [
        (recorded, BLUE, "recorded a(k)"),
        (predicted, GREEN, "predicted from the samples before"),
        (&residual, VERMILION, "residual ε(k)"),
    ];
    let own = highest_of(recorded.iter().chain(predicted).copied());
    let highest = peak_m_s2.or(own).map_or(1.0, |peak| 1.06 * peak);
    let end_ms = 1000.0 * recorded.len().max(1) as f64 / rate_hz;
    let entries = curves.map(|(_, colour, name)| {
        (
            Swatch::Line {
                colour,
                dashed: false,
            },
            name,
        )
    });
    picture(caption, (960, 460), |area, panels| {
        let below = legend(area, &entries)?;
        let height = (below.dim_in_pixel().1 - px(34)) / 3;
        let (first, rest) = below.split_vertically(height);
        let (second, third) = rest.split_vertically(height);
        let panes = [
            (first, Ticks::Blank(10)),
            (second, Ticks::Blank(10)),
            (third, Ticks::Numbers(10)),
        ];
        for ((pane, ticks), (values, colour, name)) in panes.into_iter().zip(curves) {
            let x = Axis {
                range: 0.0..end_ms,
                quantity: TIME_MS,
                ticks,
            };
            let y = Axis {
                range: -highest..highest,
                quantity: ACCELERATION,
                ticks: Ticks::Numbers(4),
            };
            let mut plot = axes(&pane, name, &x, &y)?;
            let points = values.iter().enumerate();
            let points = points.map(|(n, value)| (1000.0 * n as f64 / rate_hz, *value));
            plot.curve("", points, Stroke::solid(colour, 2))?;
            panels.push(plot.panel);
        }
        Ok(())
    })
}

/// Power of what excites a model.
const VARIANCE: Quantity<'static> = Quantity::new("variance of the excitation", "(m/s²)²");

/// The paper's figure 9: the grid of models of a texture and a motion over it. Circles have areas as the excitation's
/// variance, to one scale up to `largest_variance` where pictures are compared.
///
/// `nodes` are speed (mm/s), force (N) and variance, (m/s²)²; `motion` goes through speeds and forces.
///
/// # Errors
/// A picture that cannot be laid out.
pub fn grid_and_motion(
    caption: &Caption<'_>,
    texture: &str,
    nodes: &[(f64, f64, f64)],
    motion: &[(f64, f64)],
    largest_variance: Option<f64>,
) -> Result<Svg> {
    let largest = |of: fn(&(f64, f64, f64)) -> f64| nodes.iter().map(of).fold(0.0, f64::max);
    let (speed, force, variance) = (largest(|n| n.0), largest(|n| n.1), largest(|n| n.2));
    let variance = largest_variance.unwrap_or(variance);
    let range = |highest: f64| 0.0..if highest > 0.0 { 1.08 * highest } else { 1.0 };
    let x = Axis {
        range: range(speed),
        quantity: SPEED,
        ticks: Ticks::Numbers(12),
    };
    let y = Axis {
        range: range(force),
        quantity: FORCE,
        ticks: Ticks::Numbers(8),
    };
    let most = if variance < 0.01 {
        format!("{variance:.1e}")
    } else {
        format!("{variance:.2}")
    };
    let node = format!("a node; its area is the excitation's variance σ², at most {most} (m/s²)²");
    let entries = [
        (Swatch::Disc(BLUE), node.as_str()),
        (
            Swatch::Line {
                colour: VERMILION,
                dashed: false,
            },
            "a motion between them",
        ),
    ];
    picture(caption, (960, 400), |area, panels| {
        let below = legend(area, &entries)?;
        let mut plot = axes(&below, "", &x, &y)?;
        let chart = &mut plot.chart;
        chart.draw_series(nodes.iter().map(|&(speed, force, own)| {
            let share = if variance > 0.0 {
                (own / variance).sqrt()
            } else {
                0.0
            };
            let radius = at(2) + (f64::from(at(9)) * share) as i32;
            Circle::new((speed, force), radius, BLUE.mix(0.55).filled())
        }))?;
        chart.draw_series(
            nodes
                .iter()
                .map(|&(speed, force, _)| Cross::new((speed, force), at(2), line(INK, 1))),
        )?;
        chart.draw_series(LineSeries::new(motion.iter().copied(), line(VERMILION, 4)))?;
        let places: Vec<(f64, f64)> = nodes.iter().map(|node| (node.0, node.1)).collect();
        let variances = nodes.iter().map(|node| node.2).collect();
        let mut of_nodes = Series::new("node", Kind::Points, BLUE, &places);
        of_nodes.z = Some(Third::new(VARIANCE, variances));
        // A motion turns back, so that it is no curve over speed.
        let of_motion = Series::new("motion", Kind::Points, VERMILION, motion);
        plot.panel.series.extend([of_nodes, of_motion]);
        plot.panel.plays = Some(texture.to_owned());
        panels.push(plot.panel);
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;

    const CAPTION: Caption<'_> = Caption {
        title: "test",
        simulated: false,
    };

    #[test]
    fn pictures_stay_within_their_frames_whatever_is_drawn() {
        let wave: Vec<f64> = (0..500).map(|n| f64::from(n).sin()).collect();
        let odd = vec![f64::NAN; 500];
        for (recorded, predicted) in [
            (&wave, &wave),
            (&wave, &odd),
            (&odd, &odd),
            (&vec![], &vec![]),
        ] {
            let svg = forward_prediction(&CAPTION, recorded, predicted, 5000.0, None).unwrap();
            assert_drawn_within(&svg, 960, 460);
        }
        let nodes = [(20.0, 0.2, 0.1), (300.0, 1.4, 2.0), (20.0, 1.4, 0.0)];
        let motion = [(0.0, 0.0), (150.0, 0.7)];
        assert_drawn_within(
            &grid_and_motion(&CAPTION, "t", &nodes, &motion, None).unwrap(),
            960,
            400,
        );
        grid_and_motion(&CAPTION, "t", &[], &[], Some(1.0)).unwrap();
    }
}
