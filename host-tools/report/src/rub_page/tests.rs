//! Tests of the page and its data against the library that they show.

use model_format::{CodeSpec, Library, NodeFlags, NodeSpec, Provenance, TextureSpec, encode};
use stylus_dsp::spectrum::PowerSpectrum;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::digest::of_plan;
use stylus_kernel::scene::Plan;

use super::spectra::{Spectrum, band_centres_hz, model_spectrum, recorded_spectrum};
use super::*;
use crate::html::assert_fetches_nothing;
use test_helpers::near;

/// A texture of two speeds by one force: white noise of 2 m/s², and a resonance of 3 m/s².
fn texture(name: &str, provenance: Provenance) -> TextureSpec {
    let node = |rms: f32, codes: &[i16]| NodeSpec {
        output_power: rms * rms,
        prediction_error_power: rms * rms / 2.0,
        flags: NodeFlags::NONE,
        codes: CodeSpec::lattice(codes.to_vec()),
    };
    TextureSpec {
        provenance,
        ..TextureSpec::new(
            name,
            &[50.0, 100.0],
            &[1.0],
            vec![node(2.0, &[]), node(3.0, &[-27_000, 29_000])],
        )
    }
}

fn page_of(specs: &[TextureSpec]) -> (String, Written) {
    let bytes = encode(specs).unwrap();
    let library = Library::decode(&bytes).unwrap();
    let inputs = Inputs {
        library: &library,
        bytes: &bytes,
        recordings: None,
        seed: 7,
        plant: None,
    };
    page(&inputs, || ()).unwrap()
}

/// Returns the content of the element `id`.
fn element<'a>(page: &'a str, id: &str) -> &'a str {
    let begin = page.find(&format!("id=\"{id}\">")).unwrap();
    let content = &page[begin + id.len() + 6..];
    &content[..content.find("</").unwrap()]
}

fn data_of(page: &str) -> serde_json::Value {
    serde_json::from_str(element(page, "data")).unwrap()
}

#[test]
fn a_page_needs_nothing_but_itself_and_no_name_ends_its_elements() {
    let hostile = "</script><b>alert(1)\u{200f}\u{2028}";
    let (text, _) = page_of(&[texture(hostile, Provenance::Recorded)]);
    assert_eq!(text.matches("<script").count(), 6);
    assert_eq!(text.matches("</script>").count(), 6);
    assert_eq!(text.matches("</template>").count(), 3);
    assert!(!text.contains("<b>alert"), "a name is markup");
    assert_eq!(data_of(&text)["textures"][0]["name"], hostile);
    assert_fetches_nothing(&text);
}

/// A script that is in no list would never run, and no other test would notice.
#[test]
fn every_script_of_the_folder_is_in_the_page() {
    let (text, _) = page_of(&[texture("felt", Provenance::Recorded)]);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/rub_page");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "js") {
            let script = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains(&script), "{}", path.display());
            count += 1;
        }
    }
    assert!(count >= WORKLET.len());
}

#[test]
fn the_digests_are_those_of_the_reference_arithmetic() {
    let specs = [
        texture("felt", Provenance::Recorded),
        texture("silk", Provenance::Recorded),
    ];
    let (text, written) = page_of(&specs);
    let bytes = encode(&specs).unwrap();
    for (index, texture) in Library::decode(&bytes).unwrap().textures().enumerate() {
        let digest = of_plan::<Portable>(Plan::of_texture(texture)).value();
        let digest = format!("{digest:08x}");
        assert_eq!(data_of(&text)["digest"]["of_textures"][index], digest);
        assert_eq!(written.digests[index], (texture.name().to_owned(), digest));
    }
}

/// Checks a page's spectra by an independent computation: the density of white noise is flat, and the power of a
/// resonance between 20 and 1000 Hz is the integral of the spectrum estimated from its synthesis.
#[test]
fn spectra_have_the_level_of_what_is_played() {
    let bytes = encode(&[texture("felt", Provenance::Recorded)]).unwrap();
    let library = Library::decode(&bytes).unwrap();
    let texture = library.texture_at(0).unwrap();
    let flat = 10.0 * (4.0f64 / 2500.0).log10();
    for level in model_spectrum(&texture.node(0, 0), 5000.0).levels_db() {
        near(level.unwrap(), flat, 0.02);
    }
    let motion = stylus_signals::playing::motion::MotionPath::constant(
        model_format::MillimetresPerSecond(100.0),
        model_format::Newton(1.0),
    );
    let rendered = stylus_signals::playing::render::render(texture, &motion.unwrap(), 300.0, 3).unwrap();
    let signal = rendered.accelerations_m_s2();
    let model = model_spectrum(&texture.node(1, 0), 5000.0);
    let heard = recorded_spectrum(std::slice::from_ref(&signal)).unwrap();
    let pairs = model.levels_db().flatten().zip(heard.levels_db().flatten());
    for (hz, (model, heard)) in band_centres_hz().zip(pairs).filter(|pair| pair.0 > 100.0) {
        let difference = model - heard;
        assert!(difference.abs() < 1.5, "{hz} Hz: {difference} dB");
    }
    // Levels agree to half a step of the page's codes, and silence stays silence.
    let top_db = model.highest_db() + 0.3;
    for (code, level) in model.codes(top_db).iter().zip(model.levels_db().flatten()) {
        near(top_db - f64::from(*code) / 2.0, level, 0.2501);
    }
    assert!(Spectrum::silence().codes(0.0).iter().all(|&code| code == 255));
    let density = PowerSpectrum::welch(&signal, 5000.0);
    let edge = (0.5f64 / 12.0).exp2();
    let centres: Vec<f64> = band_centres_hz().collect();
    let (low, high) = (centres[0] / edge, centres[centres.len() - 1] * edge);
    let power: f64 = centres
        .iter()
        .zip(model.levels_db().flatten())
        .map(|(hz, level)| 10f64.powf(level / 10.0) * hz * (edge - 1.0 / edge))
        .sum();
    let ratio = power / density.power_between(low, high);
    assert!((0.93..1.07).contains(&ratio), "{ratio}");
}

#[test]
fn a_hundred_textures_have_a_short_title_and_add_no_markup() {
    let names: Vec<String> = (0..100).map(|n| format!("texture {n}")).collect();
    let specs = names.iter().map(|name| texture(name, Provenance::Recorded));
    let (text, _) = page_of(&specs.collect::<Vec<_>>());
    assert_eq!(data_of(&text)["title"], "Rub one of 100 textures");
    assert_eq!(text.matches("<template").count(), 3);
}

#[test]
fn a_page_without_recordings_maps_levels_and_says_that_there_are_none() {
    let (text, written) = page_of(&[texture("felt", Provenance::Recorded)]);
    let data = data_of(&text);
    let of_texture = &data["textures"][0];
    assert_eq!(of_texture["nodes"]["costs"], serde_json::Value::Null);
    assert_eq!(of_texture["recorded_base64"], serde_json::Value::Null);
    assert_eq!(of_texture["nodes"]["rms_m_s2"][1], 3.0);
    assert_eq!(written.clips, 0);
    assert_eq!(data["clips"].as_array().unwrap().len(), 0);
    assert!(data["clip_note"].as_str().unwrap().contains("No recordings"));
    assert!(text.contains("id=\"map-level\""));
}
