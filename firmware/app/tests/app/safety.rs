//! Bounds of the output that hold for all inputs, settings and timings.

use fake_stylus::device::settings_with as with;
use model_format::link::{
    BUILT_FOR_GAIN, BUILT_FOR_OHM, LINK_LOST_AFTER_MS, MAX_COIL_POWER_WATT, MAX_PIN_MEAN_SQUARE,
    MAX_THERMAL_TIME_CONSTANT_S, STALE_AFTER_MS, Setting, Settings, Tighter,
};
use model_format::{DacCode, OutputSample, PlayRate};
use proptest::prelude::*;
use stylus_app::safety::{Config, Heat, MOST_HELD_TICKS, OVERSAMPLING, PEAK_POWER_RATIO, State};
use stylus_app::{SAMPLE_RATE_HZ, TICKS_PER_MS};

use crate::budget;

const RATE: f64 = SAMPLE_RATE_HZ as f64;

/// Codes per second at the pin.
const PIN_RATE: f64 = RATE * OVERSAMPLING as f64;

/// Delay of the interpolator at low frequencies, codes.
const DELAY_CODES: f64 = 13.5;

/// The codes of one tick at mid-scale.
const REST: [DacCode; OVERSAMPLING] = [DacCode::MID_SCALE; OVERSAMPLING];

/// Settings that pass a signal unchanged, except for `changes`.
fn transparent_but(changes: &[(Setting, f32)]) -> Settings {
    let transparent = [
        (Setting::HardLimit, 1.45),
        (Setting::SlewLimit, 16.0),
        (Setting::PowerLimit, 1.0),
        (Setting::SoftStart, 1.0),
        (Setting::MuteRamp, 1.0),
        (Setting::OutputGain, 0.1),
    ];
    with(&[&transparent, changes].concat())
}

/// Any settings of the output's stages; the ends of the ranges occur often.
fn any_settings() -> impl Strategy<Value = Settings> {
    let output = [
        Setting::OutputGain,
        Setting::AmplifierGain,
        Setting::HardLimit,
        Setting::SlewLimit,
        Setting::CoilResistance,
        Setting::ThermalTimeConstant,
        Setting::PowerLimit,
        Setting::SoftStart,
        Setting::MuteRamp,
    ];
    let share = prop_oneof![Just(0.0f64), Just(1.0), 0.0..1.0f64];
    prop::collection::vec(share, output.len()).prop_map(move |shares| {
        let value = |(setting, share): (Setting, f64)| {
            let spec = setting.spec();
            let (low, high) = (f64::from(spec.lowest), f64::from(spec.highest));
            // A range of several decades is covered evenly by decades.
            let value = if low > 0.0 {
                low * (high / low).powf(share)
            } else {
                low + (high - low) * share
            };
            (setting, (value as f32).clamp(spec.lowest, spec.highest))
        };
        with(&output.into_iter().zip(shares).map(value).collect::<Vec<_>>())
    })
}

/// Inputs that stress the limits: noise, steps, full scale, silence, each for a while.
fn any_input() -> impl Strategy<Value = Vec<(i32, i32, bool, u16)>> {
    let level = prop_oneof![
        Just(i32::MAX),
        Just(i32::MIN),
        Just(0),
        any::<i32>(),
        -(1 << 24)..1 << 24
    ];
    prop::collection::vec((level.clone(), level, prop::bool::weighted(0.3), 1u16..600), 1..24)
}

/// Samples of an input, in pairs of each sample and the next; each piece of the input alternates between two levels.
fn samples(pieces: &[(i32, i32, bool, u16)]) -> impl Iterator<Item = ([OutputSample; 2], bool)> {
    pieces.iter().flat_map(|&(a, b, muted, length)| {
        let level = move |n: u16| OutputSample(if n % 7 < 3 { a } else { b });
        (0..length).map(move |n| ([level(n), level(n + 1)], muted))
    })
}

fn offset(code: DacCode) -> i32 {
    i32::from(code.get()) - i32::from(DacCode::MID_SCALE.get())
}

/// Offsets of the codes of one tick from mid-scale.
fn offsets(codes: [DacCode; OVERSAMPLING]) -> [i32; OVERSAMPLING] {
    codes.map(offset)
}

/// Power in the coil for an offset, in units of the power limit.
fn power(settings: &Settings, offset: i32) -> f64 {
    let volt = f64::from(offset) * f64::from(DacCode::STEP.0) * f64::from(settings.get(Setting::AmplifierGain));
    let limit = settings.get(Setting::CoilResistance) * settings.get(Setting::PowerLimit);
    let at_the_pin = (f64::from(offset) * f64::from(DacCode::STEP.0)).powi(2);
    // Whatever the settings are, the cap of the image bounds the coil.
    (volt * volt / f64::from(limit)).max(at_the_pin / f64::from(MAX_PIN_MEAN_SQUARE))
}

/// Thermal model of the coil in floating point, from the equation.
struct Coil {
    rise: f64,
    share: f64,
}

impl Coil {
    fn new(settings: &Settings) -> Self {
        let seconds = f64::from(settings.get(Setting::ThermalTimeConstant));
        Self {
            rise: 0.75,
            share: 1.0 / (seconds * PIN_RATE),
        }
    }

    fn follow(&mut self, power: f64) {
        self.rise += (power - self.rise) * self.share;
    }
}

/// A rate at which a stylus plays.
fn any_rate() -> impl Strategy<Value = PlayRate> {
    prop::sample::select(&PlayRate::ALL)
}

/// The codes of a tick: of the first sample, or at 10 kHz of both.
fn process(state: &mut State, config: &Config, pair: [OutputSample; 2], muted: bool) -> [DacCode; OVERSAMPLING] {
    match config.rate() {
        PlayRate::Hz5000 => state.process(config, pair[0], muted),
        PlayRate::Hz10000 => state.process_pair(config, pair, muted),
    }
}

fn sine(amplitude: f64, hertz: f64, n: u32) -> OutputSample {
    let value = amplitude * (core::f64::consts::TAU * hertz * f64::from(n) / RATE).sin();
    OutputSample((value * f64::from(1 << OutputSample::FRACTION_BITS)) as i32)
}

proptest! {
    #![proptest_config(budget::config(300))]

    /// No device does this, because a device mutes before settings change. Only the slew limit gives way to a lower
    /// hard limit.
    #[test]
    fn a_change_of_settings_in_the_middle_of_playing_keeps_every_other_limit_and_overflows_nothing(
        all in prop::collection::vec((any_settings(), 0.0f32..=4.0, any_input()), 2..4),
        rate in any_rate(),
    ) {
        let (settings, gain, _) = &all[0];
        let mut state = State::new(&Config::at_rate(settings, *gain, rate));
        let mut before = Some(0);
        for (settings, gain, input) in &all {
            let config = Config::at_rate(settings, *gain, rate);
            let limit = f64::from(settings.hard_limit().0) / f64::from(DacCode::STEP.0);
            let slew = f64::from(settings.get(Setting::SlewLimit)) * 1e3 / PIN_RATE / f64::from(DacCode::STEP.0);
            for (sample, muted) in samples(input) {
                for now in offsets(process(&mut state, &config, sample, muted)) {
                    prop_assert!(f64::from(now.abs()) <= limit);
                    prop_assert!(power(settings, now) <= f64::from(PEAK_POWER_RATIO) * 1.0001);
                    if let Some(before) = before.replace(now) {
                        prop_assert!(f64::from((now - before).abs()) <= slew.max(1.0));
                    }
                }
            }
            before = None;
        }
        // Whatever happened before: the mute under the last settings ends in silence after their time.
        let (settings, gain, _) = all.last().expect("there are two");
        let config = Config::at_rate(settings, *gain, rate);
        for _ in 0..config.mute_ticks() {
            process(&mut state, &config, [OutputSample(i32::MIN); 2], true);
        }
        prop_assert!(state.is_at_rest());
    }

    /// The heat is the mean square of what was put out, however the settings changed meanwhile.
    #[test]
    fn no_history_of_changes_cools_the_coil_or_loses_heat(
        all in prop::collection::vec((any_settings(), 0.0f32..=4.0, any_input()), 1..6),
        rate in any_rate(),
    ) {
        let (settings, gain, _) = &all[0];
        let mut state = State::new(&Config::at_rate(settings, *gain, rate));
        let volts = |heat: Heat| heat.to_bits() as f64 / f64::from(1 << 30) * f64::from(DacCode::STEP.0).powi(2);
        let mut expected = volts(state.heat());
        for (settings, gain, input) in &all {
            let config = Config::at_rate(settings, *gain, rate);
            let share = 1.0 / (f64::from(settings.get(Setting::ThermalTimeConstant)) * RATE);
            for (sample, muted) in samples(input) {
                let codes = offsets(process(&mut state, &config, sample, muted));
                let square = codes.map(|code| (f64::from(code) * f64::from(DacCode::STEP.0)).powi(2));
                expected += (square.iter().sum::<f64>() / OVERSAMPLING as f64 - expected) * share;
            }
            let heat = volts(state.heat());
            prop_assert!(heat >= expected * 0.9999, "{heat} {expected}");
            prop_assert!(heat <= expected * 1.001 + 1e-8, "{heat} {expected}");
            prop_assert!(Heat::from_bits(state.heat().to_bits()) == Some(state.heat()));
        }
    }

    #[test]
    fn no_input_warms_the_coil_past_its_limit(
        settings in any_settings(), gain in 0.0f32..=4.0, input in any_input(), rate in any_rate(),
    ) {
        let config = Config::at_rate(&settings, gain, rate);
        let (mut state, mut coil) = (State::new(&config), Coil::new(&settings));
        for _ in 0..4 {
            for (sample, muted) in samples(&input) {
                for now in offsets(process(&mut state, &config, sample, muted)) {
                    coil.follow(power(&settings, now));
                }
                prop_assert!(coil.rise < 1.1, "rise {}", coil.rise);
            }
        }
        let load = f64::from(state.thermal_load_permille(&config)) / 1000.0;
        // The device's value is below the model by no more than the round-off, and seldom much above the model.
        prop_assert!(load > coil.rise - 0.005 && load < coil.rise * 1.01 + 0.1, "{load} {}", coil.rise);
    }

    #[test]
    fn whoever_is_muted_is_at_exactly_mid_scale_in_time(
        settings in any_settings(), gain in 0.0f32..=4.0, input in any_input(), rate in any_rate(),
    ) {
        let config = Config::at_rate(&settings, gain, rate);
        let mut state = State::new(&config);
        for (sample, _) in samples(&input) {
            process(&mut state, &config, sample, false);
        }
        for _ in 0..config.mute_ticks() {
            process(&mut state, &config, [OutputSample(i32::MAX); 2], true);
        }
        prop_assert!(state.is_at_rest());
        for (sample, _) in samples(&input) {
            prop_assert_eq!(process(&mut state, &config, sample, true), REST);
        }
        // 2 ms are for the detection of stale inputs.
        let allowed_ms = 100 - STALE_AFTER_MS.max(LINK_LOST_AFTER_MS) - 2;
        prop_assert!(config.mute_ticks() <= allowed_ms * TICKS_PER_MS, "{} samples", config.mute_ticks());
    }

    #[test]
    fn silence_is_exactly_mid_scale_in_bounded_time(
        settings in any_settings(), input in any_input(), rate in any_rate(),
    ) {
        let config = Config::at_rate(&settings, 1.0, rate);
        let mut state = State::new(&config);
        for (sample, muted) in samples(&input) {
            process(&mut state, &config, sample, muted);
        }
        // The DC blocker settles with a time constant of 80 ms.
        for _ in 0..3 * SAMPLE_RATE_HZ {
            process(&mut state, &config, [OutputSample::SILENCE; 2], false);
        }
        for _ in 0..100 {
            prop_assert_eq!(process(&mut state, &config, [OutputSample::SILENCE; 2], false), REST);
        }
    }

    #[test]
    fn a_constant_input_leaves_no_direct_current(
        settings in any_settings(), level: i32, rate in any_rate(),
    ) {
        let config = Config::at_rate(&settings, 1.0, rate);
        let mut state = State::new(&config);
        for _ in 0..4 * SAMPLE_RATE_HZ {
            process(&mut state, &config, [OutputSample(level); 2], false);
        }
        prop_assert_eq!(process(&mut state, &config, [OutputSample(level); 2], false), REST);
    }

    /// The mute ramp takes the same time at both rates, and the limits of codes are the same.
    #[test]
    fn what_a_limit_is_in_time_it_is_at_both_rates(settings in any_settings()) {
        let [slow, fast] = PlayRate::ALL.map(|rate| Config::at_rate(&settings, 1.0, rate));
        prop_assert_eq!((fast.limit_steps(), fast.slew_steps()), (slow.limit_steps(), slow.slew_steps()));
        prop_assert!(slow.mute_ticks().abs_diff(fast.mute_ticks()) <= 1);
    }
}

#[test]
fn within_the_limits_the_output_is_the_input_times_the_gain() {
    let config = Config::new(&transparent_but(&[]), 0.5);
    let mut state = State::new(&config);
    // 0.05 V per m/s² and 5 m/s² are 0.25 V.
    for n in 0..SAMPLE_RATE_HZ {
        let codes = offsets(state.process(&config, sine(5.0, 100.0, n), false));
        // At 100 Hz a corner at 2 Hz shifts the phase by 0.02 rad.
        for (code, offset) in (n * OVERSAMPLING as u32..).zip(codes) {
            let volt = f64::from(offset) * f64::from(DacCode::STEP.0);
            let seconds = (f64::from(code) - DELAY_CODES) / PIN_RATE;
            let expected = 0.25 * (core::f64::consts::TAU * 100.0 * seconds).sin();
            if n > SAMPLE_RATE_HZ / 2 {
                assert!((volt - expected).abs() < 0.01, "{n}: {volt} {expected}");
            }
        }
    }
    let counters = state.counters();
    assert_eq!(
        (counters.hard_limited, counters.slew_limited, counters.thermally_limited),
        (0, 0, 0)
    );
}

#[test]
fn a_soft_start_rises_in_its_time_and_a_mute_falls_in_its() {
    let ramps = [(Setting::SoftStart, 500.0), (Setting::MuteRamp, 20.0)];
    let config = Config::new(&transparent_but(&ramps), 0.5);
    let mut state = State::new(&config);
    // The envelope of a sine of 500 Hz, as the highest of each 2 ms.
    let mut envelope = |first: u32, samples: u32, muted: bool| -> Vec<i32> {
        let codes: Vec<_> = (first..first + samples)
            .flat_map(|n| offsets(state.process(&config, sine(5.0, 500.0, n), muted)))
            .map(i32::abs)
            .collect();
        codes
            .chunks(10 * OVERSAMPLING)
            .map(|chunk| chunk.iter().copied().max().unwrap_or(0))
            .collect()
    };
    let rise = envelope(0, 3_000, false);
    let full = rise[290];
    // A quarter of a second is half of the ramp, and half a second is all of it.
    assert!((rise[124] - full / 2).abs() < full / 50, "{} of {full}", rise[124]);
    assert!(rise[245] > full * 97 / 100 && rise[50] < full / 4);
    let fall = envelope(3_000, 200, true);
    assert!((fall[4] - full * 6 / 10).abs() < full / 8, "{} of {full}", fall[4]);
    // After the 100 ticks of the ramp the interpolator needs 13 more.
    assert!(fall[12..].iter().all(|&level| level == 0), "{fall:?}");
}

#[test]
fn an_endless_overload_is_held_below_the_power_limit_without_a_jump() {
    let settings = transparent_but(&[
        (Setting::PowerLimit, 0.01),
        (Setting::ThermalTimeConstant, 2.0),
        (Setting::AmplifierGain, 2.0),
    ]);
    let config = Config::new(&settings, 1.0);
    let (mut state, mut coil) = (State::new(&config), Coil::new(&settings));
    let (mut energy, mut gains) = (0.0, vec![]);
    for n in 0..30 * SAMPLE_RATE_HZ {
        for now in offsets(state.process(&config, sine(1e3, 250.0, n), false)) {
            let now = power(&settings, now);
            coil.follow(now);
            energy += if n >= 20 * SAMPLE_RATE_HZ { now } else { 0.0 };
        }
        gains.push(state.thermal_gain_permille(&config));
        assert!(coil.rise <= 1.0, "{}", coil.rise);
    }
    let mean = energy / (10.0 * PIN_RATE);
    assert!(mean < 1.0, "mean power is {mean} of the limit");
    assert!(mean > 0.75, "mean power is {mean} of the limit");
    // The gain falls by four times the rise, which grows fastest at the peak power.
    let steepest = (4e3 * f64::from(PEAK_POWER_RATIO) / (2.0 * RATE)).ceil() as u16 + 1;
    let step = gains.windows(2).map(|pair| pair[0].abs_diff(pair[1])).max();
    assert!(step <= Some(steepest), "{step:?} of {steepest}");
    assert!(state.counters().thermally_limited > 20 * SAMPLE_RATE_HZ);
}

/// The loudest settings that a host can set: a coil that bears anything, behind an amplifier of hardly any gain.
fn all_protection_told_away() -> Settings {
    let loosest = |setting: Setting| match setting.tighter() {
        Some(Tighter::Lower) => Some((setting, setting.spec().highest)),
        Some(Tighter::Higher) => Some((setting, setting.spec().lowest)),
        None => None,
    };
    with(&Setting::ALL.into_iter().filter_map(loosest).collect::<Vec<_>>())
}

#[test]
fn no_settings_drive_the_pin_beyond_the_mean_square_that_this_image_is_built_for() {
    const SECONDS: u32 = 120;
    let settings = all_protection_told_away();
    let config = Config::new(&settings, 4.0);
    let mut state = State::new(&config);
    let (mut square, mut peak) = (0.0, 0.0f64);
    for n in 0..SECONDS * SAMPLE_RATE_HZ {
        let sample = sine(1e3, 100.0, n);
        for offset in offsets(state.process(&config, sample, false)) {
            let volt = f64::from(offset) * f64::from(DacCode::STEP.0);
            square += volt * volt;
            peak = peak.max(volt.abs());
        }
    }
    let mean = square / (f64::from(SECONDS) * PIN_RATE);
    let most = f64::from(MAX_PIN_MEAN_SQUARE);
    let seconds = f64::from(MAX_THERMAL_TIME_CONSTANT_S);
    // The heat began at three quarters of the limit and may end at 1.1 of the limit.
    let above = 1.1 + 0.35 * seconds / f64::from(SECONDS);
    assert!(mean <= most * above, "{:.2} V RMS, {peak:.2} V peak", mean.sqrt());
    assert!(peak <= (f64::from(PEAK_POWER_RATIO) * most).sqrt());
    let limits = config.output_limits(&settings);
    assert!(limits.is_capped && limits.mean_square == MAX_PIN_MEAN_SQUARE);
    assert!(f64::from(limits.peak_volt) >= peak * 0.9999);
}

#[test]
fn the_hardware_that_the_image_is_built_for_stays_below_the_cap_of_power() {
    let square = f64::from(MAX_PIN_MEAN_SQUARE) * f64::from(BUILT_FOR_GAIN).powi(2);
    let watt = square / f64::from(BUILT_FOR_OHM);
    assert!((watt - f64::from(MAX_COIL_POWER_WATT)).abs() < 1e-6);
}

#[test]
fn a_tighter_limit_counts_for_the_heat_that_is_there_and_a_round_trip_changes_nothing() {
    let coil = |watt| {
        with(&[
            (Setting::AmplifierGain, 10.0),
            (Setting::PowerLimit, watt),
            (Setting::OutputGain, 0.1),
        ])
    };
    let [loose, tight] = [1.0, 0.01].map(|watt| Config::new(&coil(watt), 4.0));
    let mut state = State::new(&loose);
    for n in 0..30 * SAMPLE_RATE_HZ {
        state.process(&loose, sine(100.0, 100.0, n), false);
    }
    let before = state.thermal_load_permille(&loose);
    assert!((750..1100).contains(&before), "{before}");
    // One silent tick with the tighter limit, and one with the looser one again.
    state.process(&tight, OutputSample::SILENCE, true);
    let tighter = state.thermal_load_permille(&tight);
    assert!(tighter.abs_diff(before.saturating_mul(100)) < before, "{tighter}");
    assert_eq!(state.thermal_gain_permille(&tight), 0);
    state.process(&loose, OutputSample::SILENCE, true);
    assert!(state.thermal_load_permille(&loose).abs_diff(before) <= 1);
}

#[test]
fn ticks_that_are_missed_warm_the_coil_by_the_code_that_was_held() {
    let config = Config::new(&transparent_but(&[]), 1.0);
    let play = |missed: u32| {
        let mut state = State::new(&config);
        for n in 0..SAMPLE_RATE_HZ {
            if n % 4 == 3 {
                state.miss(missed);
            }
            state.process(&config, sine(10.0, 100.0, n), false);
        }
        state.heat()
    };
    let [none, one, most, more] = [0, 1, MOST_HELD_TICKS, 1_000_000].map(play);
    assert!(none < one && one < most);
    // After [`MOST_HELD_TICKS`] ticks the output is at mid-scale, so further ticks add no heat.
    assert_eq!(most, more);
}

#[test]
fn counters_count_what_was_changed() {
    let counters = |limits: &[(Setting, f32)]| {
        let loud = [(Setting::SoftStart, 1.0), (Setting::OutputGain, 1.0)];
        let config = Config::new(&with(&[limits, &loud].concat()), 4.0);
        let mut state = State::new(&config);
        for n in 0..1_000 {
            state.process(&config, sine(100.0, 300.0, n), false);
        }
        state.counters()
    };
    let hard = counters(&[(Setting::HardLimit, 0.1), (Setting::SlewLimit, 16.0)]);
    assert!(hard.hard_limited > 900, "{hard:?}");
    assert!(hard.slew_limited == 0, "{hard:?}");
    assert!(counters(&[(Setting::SlewLimit, 0.1)]).slew_limited > 900);
}

/// A tone below 2 kHz at both rates: in the steady state the codes differ only by the filters' delays, so their power
/// is the same.
#[test]
fn a_tone_has_the_same_power_at_both_rates() {
    let power = |rate: PlayRate, hertz: f64| {
        let config = Config::at_rate(&transparent_but(&[]), 0.5, rate);
        let mut state = State::new(&config);
        let tone = |n: u32| {
            let seconds = f64::from(n) / f64::from(rate.hz());
            sine(5.0, hertz * seconds * RATE, 1)
        };
        let mut sum = 0.0;
        for tick in 0..2 * SAMPLE_RATE_HZ {
            let codes = match rate {
                PlayRate::Hz5000 => state.process(&config, tone(tick), false),
                PlayRate::Hz10000 => {
                    let pair = [tone(2 * tick), tone(2 * tick + 1)];
                    state.process_pair(&config, pair, false)
                }
            };
            if tick >= SAMPLE_RATE_HZ {
                let squares = offsets(codes).map(|code| f64::from(code).powi(2));
                sum += squares.iter().sum::<f64>();
            }
        }
        sum
    };
    for hertz in [40.0, 250.0, 1_000.0, 1_900.0] {
        let [slow, fast] = PlayRate::ALL.map(|rate| power(rate, hertz));
        let decibels = 10.0 * (fast / slow).log10();
        assert!(decibels.abs() < 0.15, "{decibels} dB at {hertz} Hz");
    }
}
