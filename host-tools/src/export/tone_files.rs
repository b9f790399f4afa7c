//! Envelopes as Meta's `.haptic`, version 1.0.0, and as Apple's AHAP.

use serde_json::{Value, json};

use super::envelope::{Envelope, Point};

/// Longest event of AHAP, s.
const MAX_EVENT_S: f64 = 30.0;

/// Segments of a curve of AHAP, which has at most 16 points. The next curve begins with the last point.
const SEGMENTS: usize = 15;

/// Returns the `.haptic` file of an envelope.
pub fn haptic(envelope: &Envelope, full_scale_m_s2: f64, description: &str) -> Value {
    let points = || envelope.points.iter();
    let amplitude = points().map(
        |point| json!({"time": point.time_s, "amplitude": point.normalised(full_scale_m_s2).0}),
    );
    let frequency = points().map(
        |point| json!({"time": point.time_s, "frequency": point.normalised(full_scale_m_s2).1}),
    );
    let envelopes = json!({
        "amplitude": amplitude.collect::<Vec<_>>(),
        "frequency": frequency.collect::<Vec<_>>(),
    });
    json!({
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {"editor": "stylus", "description": description},
        "signals": {"continuous": {"envelopes": envelopes}},
    })
}

/// Returns the AHAP file of an envelope: continuous events of full intensity and no sharpness, and curves that control
/// both.
pub fn ahap(envelope: &Envelope, full_scale_m_s2: f64, description: &str) -> Value {
    let points = &envelope.points;
    let end_s = points.last().map_or(0.0, |point| point.time_s);
    let events = (0..(end_s / MAX_EVENT_S).ceil() as u32).map(|index| {
        let begin_s = f64::from(index) * MAX_EVENT_S;
        json!({"Event": {
            "Time": begin_s,
            "EventType": "HapticContinuous",
            "EventDuration": MAX_EVENT_S.min(end_s - begin_s),
            "EventParameters": [
                {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
                {"ParameterID": "HapticSharpness", "ParameterValue": 0.0},
            ],
        }})
    });
    let intensity = |point: &Point| point.normalised(full_scale_m_s2).0;
    let sharpness = |point: &Point| point.normalised(full_scale_m_s2).1;
    let pattern = events
        .chain(curves("HapticIntensityControl", points, intensity))
        .chain(curves("HapticSharpnessControl", points, sharpness));
    json!({
        "Version": 1.0,
        "Metadata": {"Project": "stylus", "Description": description},
        "Pattern": pattern.collect::<Vec<_>>(),
    })
}

/// Curves of a parameter through all points, with times from the begin of each curve.
fn curves(
    parameter: &str,
    points: &[Point],
    value: impl Fn(&Point) -> f64,
) -> impl Iterator<Item = Value> {
    let begins = (0..points.len().saturating_sub(1)).step_by(SEGMENTS);
    begins.map(move |first| {
        let last = (first + SEGMENTS).min(points.len() - 1);
        let begin_s = points[first].time_s;
        let controls = points[first..=last]
            .iter()
            .map(|point| json!({"Time": point.time_s - begin_s, "ParameterValue": value(point)}));
        json!({"ParameterCurve": {
            "ParameterID": parameter,
            "Time": begin_s,
            "ParameterCurveControlPoints": controls.collect::<Vec<_>>(),
        }})
    })
}
