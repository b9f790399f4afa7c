//! Cost of the steps of fitting and of synthesis on the host. `cargo bench --locked -p host-tools` runs it.
//!
//! `cargo tasks bench-host` compares whole fits with NumPy and SciPy, as processes.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use host_tools::dsp::autocorrelation::Autocorrelation;
use host_tools::dsp::linear_prediction::{Prediction, corrected};
use host_tools::dsp::reduction::{Reduction, reduce};
use host_tools::texture::quantise::StructureChoice;
use model_format::{Library, MillimetresPerSecond, Newton};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

/// Samples per iteration of a synthesis: one second.
const SAMPLES_PER_ITERATION: usize = 5000;

/// Three axes of one coloured noise, as long as the paper's trials.
fn axes() -> Vec<Vec<f64>> {
    let mut generator = rand_pcg::Pcg64::seed_from_u64(1);
    let (mut before, mut earlier) = (0.0, 0.0);
    let signal: Vec<f64> = (0..10_000)
        .map(|_| {
            let excitation: f64 = StandardNormal.sample(&mut generator);
            let next = excitation + 1.6 * before - 0.8 * earlier;
            (before, earlier) = (next, before);
            next
        })
        .collect();
    [0.3, 0.5, 0.8]
        .map(|gain| signal.iter().map(|x| gain * x).collect())
        .to_vec()
}

fn fitting(criterion: &mut Criterion) {
    let axes = axes();
    let mut group = criterion.benchmark_group("fit");
    for (name, by) in [("pca", Reduction::Pca), ("dft321", Reduction::Dft321)] {
        group.bench_function(format!("reduce/{name}"), |bencher| {
            bencher.iter_batched(
                || axes.clone(),
                |mut axes| reduce(&mut axes, by),
                criterion::BatchSize::SmallInput,
            );
        });
    }
    let signal = reduce(&mut axes.clone(), Reduction::Pca)
        .expect("three axes are there")
        .signal;
    group.bench_function("autocorrelation/400", |bencher| {
        bencher.iter(|| Autocorrelation::of(black_box(&signal), 400));
    });
    let lags = corrected(Autocorrelation::of(&signal, 400).lags);
    group.bench_function("levinson_durbin/400", |bencher| {
        bencher.iter(|| Prediction::levinson_durbin(black_box(&lags), 400));
    });
    group.finish();
}

fn synthesis(criterion: &mut Criterion) {
    let signal = reduce(&mut axes(), Reduction::Pca)
        .expect("three axes are there")
        .signal;
    let lags = corrected(Autocorrelation::of(&signal, 400).lags);
    let prediction = Prediction::levinson_durbin(&lags, 400);
    let mut group = criterion.benchmark_group("synthesis");
    group.throughput(Throughput::Elements(SAMPLES_PER_ITERATION as u64));
    for structure in [StructureChoice::Lattice, StructureChoice::Direct] {
        let model = host_tools::dsp::model::Model {
            reflection: prediction.reflection.clone(),
            output_power: lags[0],
            flags: model_format::NodeFlags::NONE,
        };
        let grid = host_tools::texture::grid::Grid {
            speeds_mm_s: vec![50.0, 150.0],
            forces_n: vec![0.5, 1.0],
            models: vec![model; 4],
            laws: model_format::Laws::default(),
            parts: model_format::PartsSpec::default(),
        };
        let spec = model_format::TextureSpec {
            name: "bench".into(),
            sample_rate_hz: 5000,
            structure: structure.structure(),
            provenance: model_format::Provenance::Simulated,
            laws: grid.laws,
            parts: grid.parts.clone(),
            speed_axis_mm_s: grid.speeds_mm_s.clone(),
            force_axis_n: grid.forces_n.clone(),
            nodes: host_tools::texture::quantise::nodes("bench", &grid, structure)
                .expect("the model is stable"),
        };
        let bytes = model_format::encode(&[spec]).expect("the texture is sound");
        let library = Library::decode(&bytes).expect("it was just encoded");
        let texture = library.textures().next().expect("there is one");
        let mut synthesis: Synthesis<'_> = Synthesis::new(texture, 1);
        let motion = Motion::new(MillimetresPerSecond(100.0), Newton(0.7)).expect("finite");
        group.bench_function(format!("{structure:?}/400/one second"), |bencher| {
            bencher.iter(|| {
                for n in 0..SAMPLES_PER_ITERATION {
                    if n.is_multiple_of(UPDATE_INTERVAL_SAMPLES as usize) {
                        synthesis.follow(motion, UPDATE_INTERVAL_SAMPLES);
                    }
                    black_box(synthesis.next_sample());
                }
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30);
    targets = fitting, synthesis
}
criterion_main!(benches);
