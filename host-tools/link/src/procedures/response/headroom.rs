//! Headroom of a library: what it demands through the equaliser, compared with what coil, converter and limits allow.

use model_format::link::{OutputLimits, Response, Setting, Settings};
use model_format::scene::Scene;
use model_format::{Library, PlayRate, Texture};
use serde::Serialize;
use stylus_app::safety::Config;
use stylus_dsp::equaliser::{cascade_db, filtered};
use stylus_dsp::response::{BANDS, band_centre_hz, band_edges_hz, db, ratio};
use stylus_dsp::spectrum::PowerSpectrum;
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::playing::render::render;
use stylus_support::{Error, Result};

/// Duration of each node's rendering, s, and of its beginning, which is left out until textures and sections are
/// steady.
const SECONDS: f64 = 0.7;
const SETTLE_S: f64 = 0.2;

/// Demand in a third-octave band. Each figure is the largest of all nodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BandHeadroom {
    /// Centre frequency, Hz.
    pub hz: f64,
    /// Level that is asked for, m/s² RMS.
    pub asked_m_s2: f64,
    /// Level at the tip, m/s² RMS, without any limit; none where the response is not known or not trusted.
    pub tip_m_s2: Option<f64>,
    /// Level at the pin, V RMS.
    pub pin_volts: f64,
    /// Amount by which this band by itself, with the crest factor of the node's voltage, exceeds the tightest limit,
    /// dB; negative if it stays below.
    pub over_db: f64,
}

/// The demand of a texture on the output, by itself or on a scene's surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Headroom {
    /// Name of the texture.
    pub texture: String,
    /// Name of the scene whose gain and equaliser apply; none if the texture plays by itself.
    pub scene: Option<String>,
    /// Speed and force of the node with the largest demand, mm/s and N.
    pub at: [f32; 2],
    /// Amounts by which that node exceeds the limits of voltage, slew and power, dB; negative if it stays below.
    pub over_db: [f64; 3],
    /// Gain at which the texture just stays within the limits; 1 if it does so unchanged.
    pub fitting_gain: f64,
    /// Third octaves from 10 Hz to 1 kHz.
    pub bands: Vec<BandHeadroom>,
}

/// Names of the limits in [`Headroom::over_db`].
pub const LIMITS: [&str; 3] = ["voltage", "slew", "power"];

impl Headroom {
    /// The tightest limit, and by how much it is exceeded, dB.
    pub fn tightest(&self) -> (&'static str, f64) {
        LIMITS
            .into_iter()
            .zip(self.over_db)
            .fold(
                ("none", f64::NEG_INFINITY),
                |worst, now| {
                    if now.1 > worst.1 { now } else { worst }
                },
            )
    }

    /// The texture or scene, in words.
    pub fn name(&self) -> String {
        match &self.scene {
            Some(scene) => format!("scene '{scene}' on '{}'", self.texture),
            None => format!("texture '{}'", self.texture),
        }
    }

    /// Returns a line about the limit that is exceeded; none if the texture stays within all limits.
    pub fn warning(&self) -> Option<String> {
        let (limit, over_db) = self.tightest();
        let band = self.bands.iter().max_by(|a, b| a.pin_volts.total_cmp(&b.pin_volts))?;
        (over_db > 0.0).then(|| {
            format!(
                "{} exceeds the limit of {limit} by {over_db:.1} dB, mostly around {:.0} Hz: play it at a gain of \
                 {:.2}, or see `stylus headroom`",
                self.name(),
                band.hz,
                self.fitting_gain
            )
        })
    }
}

/// Computes the demand of each texture of `library`, by itself and on every surface of its scenes, on the output with
/// `settings` and the stored `response`. Taps and a scene's effects on the motion are left out.
pub fn headroom(library: &Library<'_>, settings: &Settings, response: Option<&Response>) -> Result<Vec<Headroom>> {
    let output = Output {
        limits: Config::new(settings, 1.0).output_limits(settings),
        gain: f64::from(settings.get(Setting::OutputGain)),
        // The setting is in V/ms.
        slew_per_s: 1e3 * f64::from(settings.get(Setting::SlewLimit)),
        response,
    };
    let mut all = library
        .textures()
        .map(|texture| output.asked_for(texture, None))
        .collect::<Result<Vec<_>>>()?;
    for scene in library.scenes() {
        for surface in &scene.surfaces {
            let texture = surface.texture.map(usize::from);
            if let Some(texture) = texture.and_then(|index| library.textures().nth(index)) {
                all.push(output.asked_for(texture, Some((&scene, surface.gain.into())))?);
            }
        }
    }
    Ok(all)
}

/// Limits of an output, and the response of its actuator.
struct Output<'a> {
    limits: OutputLimits,
    /// Voltage at the pin per acceleration, V per m/s².
    gain: f64,
    /// Limit of slew, V/s.
    slew_per_s: f64,
    response: Option<&'a Response>,
}

/// The demand of one node on an output.
struct Demand {
    /// Excess over the limits, like [`Headroom::over_db`].
    over_db: [f64; 3],
    /// For each third-octave band: acceleration asked for, m/s² RMS; voltage at the pin, V RMS; and ratio to the
    /// tightest limit.
    bands: [[f64; 3]; BANDS],
}

impl Output<'_> {
    /// Computes the demand of a texture, by itself or on a surface of a scene, with that surface's gain.
    fn asked_for(&self, texture: Texture<'_>, on: Option<(&Scene, f64)>) -> Result<Headroom> {
        let rate_hz = texture.sample_rate_hz();
        let rate = PlayRate::of(rate_hz).ok_or_else(|| Error::Request(format!("no stylus plays {rate_hz} Hz")))?;
        let sections = self
            .response
            .map_or_else(Default::default, |response| response.sections(rate).biquads());
        let (scene_gain, of_scene) = on.map_or((1.0, &[][..]), |(scene, gain)| (gain, scene.equaliser.as_slice()));
        let rate_hz = f64::from(rate_hz);
        let mut worst = Headroom {
            texture: texture.name().to_owned(),
            scene: on.map(|(scene, _)| scene.name.to_string()),
            at: [0.0; 2],
            over_db: [f64::NEG_INFINITY; 3],
            fitting_gain: 1.0,
            bands: Vec::new(),
        };
        let mut bands = [[0.0f64; 3]; BANDS];
        for speed in 0..texture.speed_axis().len() {
            for force in 0..texture.force_axis().len() {
                let motion = MotionPath::constant(texture.speed(speed), texture.force(force))?;
                let mut asked = render(texture, &motion, SECONDS, 1)?.accelerations_m_s2();
                asked.iter_mut().for_each(|sample| *sample *= scene_gain);
                let asked = filtered(of_scene, &asked);
                let pin: Vec<f64> = filtered(&sections, &asked)
                    .iter()
                    .map(|sample| sample * self.gain)
                    .collect();
                let skipped = (SETTLE_S * rate_hz) as usize;
                let demand = self.demand(&asked[skipped..], &pin[skipped..], rate_hz);
                let most = |over_db: [f64; 3]| over_db.into_iter().fold(f64::NEG_INFINITY, f64::max);
                // Silence is -∞ dB, which exceeds nothing. The second condition gives a silent texture a node, too.
                if most(demand.over_db) > most(worst.over_db) || worst.at == [0.0; 2] {
                    worst.at = [texture.speed(speed).0, texture.force(force).0];
                    worst.over_db = demand.over_db;
                }
                for (most, own) in bands.iter_mut().flatten().zip(demand.bands.as_flattened()) {
                    *most = most.max(*own);
                }
            }
        }
        worst.fitting_gain = ratio(-worst.tightest().1).min(1.0);
        let of_band = |(band, most)| self.band(band, most, |hz| cascade_db(&sections, rate_hz, hz));
        worst.bands = bands.into_iter().enumerate().map(of_band).collect();
        Ok(worst)
    }

    /// Computes the demand of a node that asks for the acceleration `asked`, m/s², and needs the voltage `pin`, V, for
    /// it.
    fn demand(&self, asked: &[f64], pin: &[f64], rate_hz: f64) -> Demand {
        let dense = between(pin);
        let peak = dense.iter().fold(0.0f64, |most, volts| most.max(volts.abs()));
        // Interpolation leaves the power as it is, so the samples suffice for it.
        let square = pin.iter().map(|volts| volts * volts).sum::<f64>() / pin.len() as f64;
        let slope = dense
            .windows(2)
            .fold(0.0f64, |most, pair| most.max((pair[1] - pair[0]).abs()))
            * rate_hz
            * STEPS as f64;
        let (peak_volts, rms_volts) = (
            f64::from(self.limits.peak_volt),
            f64::from(self.limits.mean_square).sqrt(),
        );
        let spectra = [asked, pin].map(|signal| PowerSpectrum::welch(signal, rate_hz));
        let crest = peak / square.sqrt().max(f64::MIN_POSITIVE);
        let of_band = |band: usize| {
            let [low, high] = band_edges_hz(band);
            let [asked, volts] = [0, 1].map(|of: usize| spectra[of].power_between(low, high).sqrt());
            let slope = std::f64::consts::TAU * band_centre_hz(band) * crest * volts / self.slew_per_s;
            let over = (crest * volts / peak_volts).max(slope);
            [asked, volts, over.max(volts / rms_volts)]
        };
        Demand {
            over_db: [
                db(peak / peak_volts),
                db(slope / self.slew_per_s),
                db((square / f64::from(self.limits.mean_square)).sqrt()),
            ],
            bands: std::array::from_fn(of_band),
        }
    }

    /// Returns the headroom in a third-octave band from the largest values that any node has there, in the order of
    /// [`Demand::bands`]. `sections_db` is the gain of the response's sections at a frequency.
    fn band(
        &self,
        band: usize,
        [asked_m_s2, pin_volts, over]: [f64; 3],
        sections_db: impl Fn(f64) -> f64,
    ) -> BandHeadroom {
        let hz = band_centre_hz(band);
        let tip_m_s2 = self
            .response
            .filter(|response| response.trusted_bands >> band & 1 == 1)
            .map(|response| {
                let level_db = f64::from(response.bands_centi_db[band]) / 100.0;
                asked_m_s2 * self.gain * ratio(level_db + sections_db(hz))
            });
        BandHeadroom {
            hz,
            asked_m_s2,
            tip_m_s2,
            pin_volts,
            over_db: db(over),
        }
    }
}

/// Steps of [`between`] per sample.
const STEPS: usize = 8;

/// Interpolates a signal between its samples, like the device's output stage, to [`STEPS`] values per sample.
///
/// The interpolating function is a sinc in a Hann window of eight samples to either side. Between its samples a signal
/// may be higher and steeper than its samples show.
fn between(samples: &[f64]) -> Vec<f64> {
    const REACH: usize = 8;
    let kernel = |t: f64| {
        let angle = std::f64::consts::PI * t;
        let sinc = if t == 0.0 { 1.0 } else { angle.sin() / angle };
        sinc * (0.5 * angle / REACH as f64).cos().powi(2)
    };
    let weights: Vec<Vec<f64>> = (0..STEPS)
        .map(|step| {
            let share = step as f64 / STEPS as f64;
            (0..2 * REACH)
                .map(|tap| kernel(tap as f64 - (REACH - 1) as f64 - share))
                .collect()
        })
        .collect();
    let at = |near: &[f64], weights: &[f64]| near.iter().zip(weights).map(|(x, w)| x * w).sum();
    samples
        // The ends, which the windows do not cover, are left out.
        .windows(2 * REACH)
        .flat_map(|near| weights.iter().map(move |weights| at(near, weights)))
        .collect()
}

#[cfg(test)]
mod tests {
    use model_format::link::SettingChange;
    use model_format::scene::{Biquad, Surface};
    use model_format::{MillimetresPerSecond, Newton};

    use super::*;
    use stylus_signals::playing::pin::Pin;
    use stylus_signals::playing::render::Rendering;
    use test_helpers::near;

    fn with(changes: &[(Setting, f32)]) -> Settings {
        changes.iter().fold(Settings::default(), |settings, &(setting, value)| {
            settings.with(SettingChange { setting, value }).unwrap()
        })
    }

    #[test]
    fn at_the_gain_that_is_told_the_loudest_node_just_fits_and_no_limit_acts() {
        let bytes = test_helpers::library(5000);
        let library = Library::decode(&bytes).unwrap();
        for (changes, limit) in [
            ([(Setting::OutputGain, 0.2), (Setting::HardLimit, 0.5)], "voltage"),
            ([(Setting::OutputGain, 0.1), (Setting::SlewLimit, 0.5)], "slew"),
            // The peak may reach 16 times the power limit, so a crest factor above 4 reaches the limit of voltage
            // first.
            ([(Setting::OutputGain, 0.05), (Setting::PowerLimit, 0.001)], "voltage"),
        ] {
            let found = &headroom(&library, &with(&changes), None).unwrap()[0];
            let (tightest, over_db) = found.tightest();
            assert!(tightest == limit && over_db > 0.0, "{found:?}");
            assert!(found.warning().unwrap().contains(limit));
            assert_eq!(found.at, [100.0, 1.0], "the loudest node");
            let fitting = changes[0].1 * found.fitting_gain as f32;
            let settings = with(&[(Setting::OutputGain, fitting), changes[1]]);
            let fits = &headroom(&library, &settings, None).unwrap()[0];
            assert!(fits.tightest().1.abs() < 1e-3 && fits.bands.iter().all(|band| band.over_db < 1e-3));
            // Two seconds have higher peaks than the half second that is examined.
            let settings = with(&[(Setting::OutputGain, 0.8 * fitting), changes[1]]);
            let motion = MotionPath::constant(MillimetresPerSecond(100.0), Newton(1.0)).unwrap();
            let rendering = Rendering::new(test_helpers::texture(&bytes), &motion, 2.0, 1).unwrap();
            let mut pin = Pin::new(rendering, PlayRate::Hz5000, &settings);
            pin.by_ref().for_each(drop);
            let limited = pin.limited();
            assert!(limited.hard + limited.slew <= 5, "{limited:?}");
        }
    }

    #[test]
    fn a_scene_asks_for_its_gain_and_its_equaliser_times_its_texture() {
        let bytes = test_helpers::library(5000);
        let library = Library::decode(&bytes).unwrap();
        let halved = Biquad::from_f64([0.5, 0.0, 0.0], [0.0, 0.0]).unwrap();
        let scene = |name: &str, gain, sections: &[Biquad]| {
            let surface = Surface {
                gain,
                ..Surface::of_texture(0)
            };
            let mut scene = Scene::of_surface(name.try_into().unwrap(), 5000, surface);
            scene.equaliser.extend(sections.iter().copied());
            scene
        };
        let scenes = [scene("double", 2.0, &[]), scene("as it is", 2.0, &[halved])];
        let bytes = stylus_fit::scene::with_scenes(&library, &scenes).unwrap();
        let library = Library::decode(&bytes).unwrap();
        let all = headroom(&library, &with(&[(Setting::OutputGain, 0.2)]), None).unwrap();
        let [.., alone, double, same] = all.as_slice() else {
            panic!("{all:?}");
        };
        for (scene, name, times) in [(double, "double", 2.0), (same, "as it is", 1.0)] {
            assert_eq!(scene.scene.as_deref(), Some(name));
            assert_eq!((&scene.texture, scene.at), (&alone.texture, alone.at));
            for (over_db, alone_db) in scene.over_db.iter().zip(alone.over_db) {
                near(over_db - alone_db, db(times), 1e-6);
            }
        }
    }
}
