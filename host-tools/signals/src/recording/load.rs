//! The samples of a trial: read, cut, resampled to the models' rate and scaled to m/s².

use std::path::Path;

use model_format::SAMPLE_RATE_HZ;
use stylus_dsp::sums::sum;
use stylus_support::csv_table::CsvTable;
use stylus_support::files;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::defects::Defects;
use super::kind::{Kind, conversion, ending};
use super::lvm::{self, LabView};
use super::polled::polled;
use super::rate::{NEAR_WHOLE, counts_before, length_fault};
use super::trial::HeldSamples;
use super::trial::Trial;
use super::trial::{Account, Cut, Samples, Source};
use super::{csv_file, numbers, resample, uneven, wav};

/// Reads the samples of `trial`: one to three axes at [`SAMPLE_RATE_HZ`], in m/s².
///
/// # Errors
/// The file cannot be read, contains no samples in the trial's part, contains more samples than a recording may have,
/// or contains a sample that is not finite; the error names the first such sample on the first axis that has one.
pub fn read(trial: &Trial) -> Result<Samples> {
    read_at(trial, SAMPLE_RATE_HZ)
}

/// Like [`read`], at `model_rate_hz`.
pub fn read_at(trial: &Trial, model_rate_hz: u32) -> Result<Samples> {
    let path = trial.file.as_path();
    let cut = Cut {
        start_s: trial.start_s,
        duration_s: trial.duration_s.unwrap_or(f64::INFINITY),
    };
    let source = match &trial.held {
        Some(held) => held.source(&cut),
        None => from_file(trial, &cut)?,
    };
    let (mut axes, mut times_s, mut remarks) = (source.channels, source.times_s, source.remarks);
    if axes.first().is_none_or(Vec::is_empty) {
        let problem = if cut.start_s > 0.0 {
            format!("holds no samples after {} s: give an earlier start_s", cut.start_s)
        } else {
            "holds no samples".to_owned()
        };
        return Err(Error::file(path, problem));
    }
    check_finite(path, &axes, source.first_frame)?;
    remarks.extend(source.unscaled.and_then(|kind| numbers::gone_on(&mut axes, kind)));
    let mut rate_hz = source.rate.hz();
    // Defects are sought among the sensor's own samples: among held values, each would be a hold or a step.
    let polled = polled(&axes, rate_hz);
    let read_at_hz = polled.is_some().then_some(rate_hz);
    if let Some(sensor) = polled {
        (axes, rate_hz, times_s) = (sensor.channels, sensor.rate_hz, None);
    }
    let defects = Defects {
        truncation: source.truncation,
        timing: source.timing,
        read_at_hz,
        ..Defects::of(&axes, rate_hz)
    };
    let whole_hz = rate_hz.round();
    // The conversion takes whole rates only. Where rounding would shift the pitch, samples are moved to even times.
    if times_s.is_none() && (rate_hz / whole_hz - 1.0).abs() > NEAR_WHOLE {
        times_s = Some((0..axes[0].len()).map(|n| n as f64 / rate_hz).collect());
    }
    rate_hz = whole_hz;
    if let Some(times) = &times_s {
        axes = uneven::evened(&axes, times, rate_hz);
    }
    if (rate_hz - f64::from(model_rate_hz)).abs() > 0.0 {
        axes = at_model_rate(path, &axes, rate_hz, model_rate_hz)?;
    }
    let scales_m_s2 = source.stated.scales_for(trial.scale_m_s2, axes.len());
    for (axis, scale) in axes.iter_mut().zip(&scales_m_s2) {
        axis.iter_mut().for_each(|sample| *sample *= scale);
    }
    let repeated = without_repeated(&mut axes);
    let has_scale = trial.scale_m_s2.is_some() || source.stated.scales_m_s2.is_some();
    let conversion = source.stated.conversion(trial.scale_m_s2);
    let recorded_hz = trial.held.as_ref().and_then(|held| held.recorded_hz());
    Ok(Samples {
        axes,
        source_rate_hz: recorded_hz.unwrap_or(rate_hz),
        defects,
        account: Account {
            remarks: remarks.into_iter().chain(conversion).chain(repeated).collect(),
            doubts: source.stated.doubt(trial.scale_m_s2).into_iter().collect(),
            // A scale says what an integer means, so nothing is left to tell.
            unscaled: source.unscaled.filter(|_| !has_scale),
            has_scale,
        },
    })
}

/// Reads samples at `rate_hz`, Hz, from the text of a table, whose names count as those of a CSV file.
///
/// # Errors
/// Those of a CSV file, or of [`HeldSamples::new`].
pub fn held_table(rate_hz: f64, text: String) -> Result<HeldSamples> {
    let trial = Trial {
        sample_rate_hz: Some(rate_hz),
        ..Trial::of("samples", "", 0.0, 0.0)
    };
    let source = csv_file::read_table(&CsvTable::of(&trial.file, text)?, &trial, None, &Cut::WHOLE)?;
    Ok(HeldSamples::new(rate_hz, source.channels.clone(), false)?.stated(&source))
}

/// Reads the part of a trial's file within `cut`.
fn from_file(trial: &Trial, cut: &Cut) -> Result<Source> {
    let path = trial.file.as_path();
    if let Some(other) = named_alike(path) {
        let problem = format!("is not there, and '{other}' is: mend the name in the list");
        return Err(Error::file(path, problem));
    }
    match Kind::of(path) {
        Some(Kind::Wave) => wav::read(path, trial.sample_rate_hz, cut),
        Some(Kind::Table) if lvm::is_lvm(path)? => {
            let LabView {
                table,
                rate_hz,
                truncation,
                remarks,
            } = lvm::read(path)?;
            let source = csv_file::read_table(&table, trial, rate_hz, cut)?;
            let given = trial.sample_rate_hz.zip(rate_hz);
            let given = given.and_then(|(given, told)| counts_before(given, "its header says", told));
            Ok(Source {
                truncation,
                remarks: remarks.into_iter().chain(given).chain(source.remarks).collect(),
                ..source
            })
        }
        Some(Kind::Table) => csv_file::read(trial, cut),
        None => {
            // A mistyped name is reported as a missing file, not as a file of an unknown kind.
            files::found(path).map_err(Error::io("read", path))?;
            let ending = ending(path);
            let problem = format!("'{ending}' files cannot be read: {}", conversion(&ending));
            Err(Error::file(path, problem))
        }
    }
}

/// Returns the name of an existing file in the same folder that differs from the missing file `path` only in capitals
/// or in its extension, which many file browsers hide.
fn named_alike(path: &Path) -> Option<String> {
    if files::exists(path) {
        return None;
    }
    let with_slashes = path.to_string_lossy().replace('\\', "/");
    if files::exists(Path::new(&with_slashes)) {
        return Some(with_slashes);
    }
    let wanted = path.file_name()?.to_string_lossy().to_lowercase();
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let beside = files::entries(folder.unwrap_or(Path::new("."))).ok()?;
    let mut names = beside.filter_map(|entry| Some(entry.ok()?.name.to_string_lossy().into_owned()));
    names.find(|name| {
        let name = name.to_lowercase();
        let is_cut =
            Kind::of(Path::new(&name)).is_some() && name.rsplit_once('.').is_some_and(|(stem, _)| stem == wanted);
        name == wanted || is_cut
    })
}

/// Removes the channels that repeat the first, inverted or not, as of a microphone in a stereo file, and says so.
/// Constant ones stay, as dead axes.
fn without_repeated(axes: &mut Vec<Vec<f64>>) -> Option<String> {
    let (first, others) = axes.split_first()?;
    let is_constant = first.iter().all(|sample| sample.to_bits() == first[0].to_bits());
    let is_inverse = |axis: &[f64]| axis.iter().zip(first).all(|(a, b)| *a == -b);
    let is_new = others
        .iter()
        .map(|axis| is_constant || axis != first && !is_inverse(axis));
    let is_new: Vec<bool> = is_new.collect();
    let count = is_new.iter().filter(|is_new| !**is_new).count();
    let mut kept = std::iter::once(true).chain(is_new);
    axes.retain(|_| kept.next() == Some(true));
    (count > 0).then(|| {
        format!(
            "{} of the same samples as channel 1, inverted or not, left out",
            counted(count, "channel")
        )
    })
}

fn check_finite(path: &Path, channels: &[Vec<f64>], first_frame: usize) -> Result<()> {
    for (channel, samples) in channels.iter().enumerate() {
        // A sum is finite only if all of its terms are, so only a bad recording takes the time of a search.
        if sum(samples).is_finite() {
            continue;
        }
        if let Some(index) = samples.iter().position(|sample| !sample.is_finite()) {
            let problem = format!(
                "sample {} of channel {} is not a finite number: cut it out (start_s, duration_s) or record it again",
                first_frame + index,
                channel + 1
            );
            return Err(Error::file(path, problem));
        }
    }
    Ok(())
}

fn at_model_rate(path: &Path, axes: &[Vec<f64>], rate_hz: f64, model_rate_hz: u32) -> Result<Vec<Vec<f64>>> {
    let frames = axes.first().map_or(0, Vec::len);
    // Checked before the conversion takes memory.
    let converted = frames as f64 * f64::from(model_rate_hz) / rate_hz;
    if let Some(fault) = length_fault(converted, axes.len()) {
        let problem = format!("at {model_rate_hz} Hz it has {fault}");
        return Err(Error::file(path, problem));
    }
    Ok(resample::resample(axes, rate_hz as u32, model_rate_hz))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{triage, unit};
    use stylus_support::float_wav::float_wav;
    use test_helpers::{holds, new_file};

    /// Samples of 2 s at 8 kHz in single precision, on two axes, with a clipped peak.
    fn axes() -> [Vec<f64>; 2] {
        [0.11, 0.023].map(|of: f64| {
            let sample = |n: u32| (of * f64::from(n)).sin().clamp(-0.9, 0.9);
            (0..16_000).map(sample).map(|x| f64::from(x as f32)).collect()
        })
    }

    #[test]
    fn samples_in_memory_are_read_as_those_of_a_wav_file() {
        let (_folder, file) = new_file("a.wav");
        let axes = axes();
        let samples = (0..16_000).flat_map(|n| [axes[0][n], axes[1][n]]);
        std::fs::write(&file, float_wav(2, 8000, samples).unwrap()).unwrap();
        let of_file = Trial {
            scale_m_s2: Some(3.0),
            start_s: 0.25,
            duration_s: Some(1.5),
            ..Trial::of(file, "felt", 100.0, 1.0)
        };
        let held = HeldSamples::new(8000.0, axes.into(), false).unwrap();
        let in_memory = Trial {
            held: Some(held.into()),
            ..of_file.clone()
        };
        let (of_file, in_memory) = (read(&of_file).unwrap(), read(&in_memory).unwrap());
        assert_eq!(of_file.axes, in_memory.axes);
        assert_eq!(of_file.defects, in_memory.defects);
        assert_eq!(in_memory.axes[0].len(), 7500);
    }

    #[test]
    fn names_of_columns_in_memory_count_as_those_of_a_file() {
        let held = |header: &str, step_s: f64| {
            let rows = (0..4000).map(|n| format!("{},{},1.5\n", step_s * f64::from(n), (0.3 * f64::from(n)).sin()));
            let text = format!("{header}\n{}", rows.collect::<String>());
            let held = held_table(5000.0, text).unwrap();
            let samples = read(&Trial {
                held: Some(held.into()),
                ..Trial::of("a", "felt", 100.0, 1.0)
            })
            .unwrap();
            (samples.axes, samples.account.remarks.concat())
        };
        let (axes, remarks) = held("time_s,accel_x_g,force_n", 2e-4);
        assert_eq!((axes.len(), axes[0][1]), (1, 0.3f64.sin() * G));
        holds(&remarks, &["force_n", "left out", "converted from g"]);
        holds(&held("time_s,accel_x_g,force_n", 1e-3).1, &["times", "5000 Hz"]);
    }

    /// A sensor: the offset of each axis and the quantisation step, g; and the gain.
    type Sensor = ([f64; 3], f64, f64);

    const SENSORS: [Sensor; 4] = [
        ([-0.035, 0.04, 0.03], 0.0039, 1.0),
        ([0.05, -0.05, -0.06], 1.0 / 16_384.0, 1.02),
        ([0.02, 0.01, 0.04], 0.001, 0.97),
        ([0.0; 3], 1e-7, 1.0),
    ];

    /// Units: the form in which they are named, their value in m/s², and the option that names them.
    const UNITS: [(&str, f64, &str); 5] = [
        ("accel_{}_g", G, "g"),
        ("{} [mg]", 1e-3 * G, "mg"),
        ("a{} (m/s²)", 1.0, "1"),
        ("{} (mm/s^2)", 1e-3, "mm/s^2"),
        ("{}_raw 256 LSB/g", G / 256.0, "g/256"),
    ];

    const G: f64 = 9.80665;

    /// The samples that are read from a table of samples with this header.
    fn of_table(header: Option<String>, axes: &[Vec<f64>], scale: Option<&str>) -> Samples {
        let (_folder, file) = new_file("a.tsv");
        let mut text = header.map_or(String::new(), |header| header + "\n");
        for n in 0..axes[0].len() {
            let row: Vec<String> = axes.iter().map(|axis| axis[n].to_string()).collect();
            text += &format!("{}\n", row.join("\t"));
        }
        std::fs::write(&file, text).unwrap();
        let trial = Trial {
            sample_rate_hz: Some(5000.0),
            scale_m_s2: scale.map(|scale| unit::scale(scale).unwrap()),
            ..Trial::of(file, "felt", 100.0, 1.0)
        };
        read(&trial).unwrap()
    }

    /// Covers each unit, each sensor, one and three axes, with and without gravity. A unit that is named by a header or
    /// by an option is converted. A unit that is not named is reported if the samples reveal it.
    #[test]
    fn a_unit_is_converted_where_it_is_named_and_told_where_it_is_not() {
        let told = |samples: &Samples| {
            triage::samples(samples, samples.slow_share())
                .iter()
                .any(|own| own.kind() == triage::Kind::Scale)
                || samples.account.unscaled.is_some()
        };
        for (name, unit_m_s2, option) in UNITS {
            for (offsets_g, step_g, gain) in SENSORS {
                for (gravity, count) in [(1.0, 3), (1.0, 1), (0.0, 3), (0.0, 1)] {
                    let step = if option == "g/256" { 1.0 } else { step_g * G / unit_m_s2 };
                    let axis = |axis: usize| -> Vec<f64> {
                        let offset = (offsets_g[axis] + if axis == 0 { gravity } else { 0.0 }) * G;
                        let noise = triage::test_signals::bounded_noise(1 + axis as u64);
                        let value = |x: f64| (gain * (x + offset) / unit_m_s2 / step).round() * step;
                        noise.into_iter().map(value).collect()
                    };
                    let axes: Vec<Vec<f64>> = (0..count).map(axis).collect();
                    let names = ["x", "y", "z"][..count].iter().map(|own| name.replace("{}", own));
                    let named = of_table(Some(names.collect::<Vec<_>>().join("\t")), &axes, None);
                    let case = format!("{option}, step {step_g}, gravity {gravity}, {count} axes");
                    let by_option = of_table(None, &axes, Some(option));
                    let converted = axes[0].iter().map(|x| x * unit_m_s2);
                    for (found, expected) in named.axes[0].iter().zip(converted) {
                        assert!((found - expected).abs() < 1e-9, "{case}");
                    }
                    assert_eq!(named.axes, by_option.axes, "{case}");
                    assert!(!told(&named) && !told(&by_option), "{case}");
                    let is_converted = !named.account.remarks.is_empty();
                    assert_eq!(is_converted, option != "1", "{case}");
                    let unnamed = of_table(None, &axes, None);
                    // Quiet samples in g look like loud samples in m/s².
                    let is_told = option != "1" && (gravity > 0.0 || option != "g");
                    assert_eq!(told(&unnamed), is_told, "{case}");
                }
            }
        }
    }

    #[test]
    fn a_given_scale_counts_before_that_of_the_header_and_the_contradiction_is_told() {
        let axes = [vec![0.5, -0.5, 0.25]];
        let header = || Some("a (mm/s²)".to_owned());
        let read = of_table(header(), &axes, Some("g"));
        assert_eq!(read.axes[0][0], 0.5 * G);
        assert!(read.account.remarks.is_empty());
        holds(&read.account.doubts.concat(), &["mm/s²", "9.80665"]);
        assert!(of_table(header(), &axes, Some("0.001")).account.doubts.is_empty());
        let volts = of_table(Some("a (V)".to_owned()), &axes, None);
        holds(&volts.account.doubts.concat(), &["says V", "sensitivity"]);
    }

    #[test]
    fn channels_that_repeat_the_first_are_left_out_and_told() {
        let (one, other) = (vec![0.5, -0.5, 0.25], vec![0.5, -0.5, 0.26]);
        for (axes, left) in [
            (vec![one.clone(), one.clone()], vec![&one]),
            (vec![one.clone(), other.clone(), one.clone()], vec![&one, &other]),
            (vec![one.clone(), one.iter().map(|x| -x).collect()], vec![&one]),
            (vec![one.clone(), other.clone()], vec![&one, &other]),
            (vec![vec![0.0; 3]; 2], vec![&vec![0.0; 3]; 2]),
        ] {
            let read = of_table(None, &axes, Some("1"));
            assert_eq!(read.axes.iter().collect::<Vec<_>>(), left);
            let told = read.account.remarks.concat();
            assert_eq!(
                told.contains("same samples as channel 1"),
                left.len() < axes.len(),
                "{told}"
            );
        }
    }

    #[test]
    fn a_comment_names_the_unit_of_columns_without_names() {
        let read = of_table(Some("# unit: g".to_owned()), &[vec![1.0, 2.0], vec![3.0, 4.0]], None);
        assert_eq!(read.axes[1], [3.0 * G, 4.0 * G]);
    }

    /// The samples of a phone's export at 400 Hz with these column names: time, three axes and their magnitude.
    fn of_phone(names: &[&str], [separator, sign]: [&str; 2]) -> Result<Samples> {
        let (_folder, file) = new_file("a.csv");
        let mut text = names.join(separator) + "\n";
        for n in 0..800 {
            let time = f64::from(n) / 400.0;
            let [x, y, z] = [0.31, 0.17, 0.043].map(|of: f64| (of * f64::from(n)).sin());
            let row = [time, x, y, z, x.hypot(y).hypot(z)].map(|value| format!("{value:e}"));
            text += &(row[..names.len()].join(separator).replace('.', sign) + "\n");
        }
        std::fs::write(&file, text).unwrap();
        read(&Trial::of(file, "felt", 100.0, 1.0))
    }

    #[test]
    fn a_magnitude_is_left_out_and_told_where_its_name_says_so() {
        let axes = |of: &str| ["x", "y", "z"].map(|axis| format!("\"{of} {axis} (m/s^2)\""));
        for of in ["Acceleration", "Linear Acceleration"] {
            let axes = axes(of);
            let [x, y, z] = axes.each_ref().map(String::as_str);
            for signs in [[",", "."], [";", ","], [";", "."], ["\t", ","]] {
                let three = of_phone(&["\"Time (s)\"", x, y, z], signs).unwrap();
                for name in [
                    "\"Absolute acceleration (m/s^2)\"",
                    "acc_total",
                    "|a| magnitude [m/s²]",
                    "Norm",
                ] {
                    let four = of_phone(&["\"Time (s)\"", x, y, z, name], signs).unwrap();
                    assert_eq!((&four.axes, four.axes.len()), (&three.axes, 3), "{name}");
                    let told = four.account.remarks.concat();
                    holds(&told, &[name.trim_matches('"'), "left out"]);
                    assert!(three.account.remarks.is_empty());
                }
                let fault = of_phone(&["\"Time (s)\"", x, y, z, "a4 (m/s^2)"], signs);
                holds(&fault.unwrap_err(), &["4 columns of samples"]);
            }
        }
        let fault = of_phone(&["0", "0", "0", "0", "0"], [",", "."]).unwrap_err();
        holds(&fault, &["5 columns of samples"]);
    }

    #[test]
    fn units_in_a_line_below_the_names_count() {
        for units in ["mg\tmg", "(mg)\t[mg]"] {
            let read = of_table(Some(format!("x\ty\n{units}")), &[vec![1.0, 2.0], vec![3.0, 4.0]], None);
            assert_eq!(read.axes[1], [3e-3 * G, 4e-3 * G]);
        }
    }

    #[test]
    fn a_column_left_out_is_told_of_a_labview_file_as_of_any_table() {
        let (_folder, file) = new_file("a.lvm");
        let mut text = "LabVIEW Measurement\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\n\nChannels\t2\n\
                        Delta_X\t0.0002\t0.0002\n***End_of_Header***\naccel\ttemperature\n"
            .to_owned();
        text.extend((0..800).map(|n| format!("{}\t21.5\n", (0.3 * f64::from(n)).sin())));
        std::fs::write(&file, text).unwrap();
        let samples = read(&Trial::of(file, "felt", 100.0, 1.0)).unwrap();
        assert_eq!(samples.axes.len(), 1);
        holds(&samples.account.remarks.concat(), &["temperature", "left out"]);
    }

    #[test]
    fn a_recording_goes_on_past_midnight() {
        let folder = tempfile::tempdir().unwrap();
        let samples = |begin: u32| {
            let file = folder.path().join("a.csv");
            let row = |n: u32| {
                let micros = begin * 1000 + 200 * n;
                let (seconds, micros) = (micros / 1_000_000, micros % 1_000_000);
                // The first time is at `begin` ms after 23:59:59.
                let time = if seconds == 0 { "23:59:59" } else { "00:00:00" };
                format!("{time}.{micros:06},{}\n", (0.3 * f64::from(n)).sin())
            };
            let rows: String = (0..2000).map(row).collect();
            std::fs::write(&file, format!("time,x\n{rows}")).unwrap();
            read(&Trial::of(file, "felt", 100.0, 1.0)).unwrap()
        };
        let (before, across) = (samples(100), samples(800));
        assert_eq!(before.axes, across.axes);
        assert_eq!(before.account.remarks, [""; 0]);
        holds(&across.account.remarks.concat(), &["start again", "86400"]);
    }
}
