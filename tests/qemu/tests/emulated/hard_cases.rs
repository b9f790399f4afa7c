//! The cases of `stylus stress` on emulated processors: no input changes the cost of a sample, and every processor
//! plays the same bits as the host.

use std::collections::BTreeMap;

use host_tools::evaluation::stress::cases::{Case, Length, suite};
use host_tools::evaluation::stress::models::library;
use kernel_vectors::job::{CAPACITY, Job, OVERHEAD_BYTES};
use kernel_vectors::{HardCase, report};
use model_format::Library;
use stylus_kernel::arithmetic::Portable;
use tasks::compare::{Cost, EmulatorReport, lines, same_bits};
use tasks::guest::Processor;
use tasks::qemu;

use crate::{held, image};

/// Number of samples per phase, with seven phases per case. It suffices for many motions, and for a state at full scale
/// to have its effects.
const SAMPLES: u32 = 60;

/// A case ready for the image.
struct Prepared {
    case: Case,
    library: Vec<u8>,
}

impl Prepared {
    fn new(case: Case) -> Self {
        let library = library(&case.nodes()).unwrap();
        Self { case, library }
    }

    fn case(&self) -> HardCase<'_> {
        HardCase {
            name: &self.case.name,
            library: &self.library,
            path: self.case.path,
            samples: SAMPLES,
        }
    }

    /// The properties on which a sample's cost may depend, as text.
    fn plan(&self) -> String {
        let library = Library::decode(&self.library).unwrap();
        let texture = library.texture_at(0).unwrap();
        let single = texture.speed_axis().len() * texture.force_axis().len() == 1;
        format!("order {}, single {single}", texture.max_order())
    }
}

/// Distributes the cases over as many jobs as they need.
fn jobs(cases: &[Prepared]) -> Vec<Vec<u8>> {
    let mut jobs: Vec<Vec<u8>> = vec![Vec::new()];
    for case in cases {
        let bytes = case.case().to_bytes();
        if jobs
            .last()
            .is_some_and(|job| job.len() + bytes.len() + OVERHEAD_BYTES > CAPACITY)
        {
            jobs.push(Vec::new());
        }
        jobs.last_mut().expect("there is one").extend(bytes);
    }
    jobs
}

/// Runs the image on `processor` with all cases, and returns its report.
fn play(processor: Processor, cases: &[Prepared]) -> EmulatorReport {
    let image = image(processor);
    let mut whole = EmulatorReport::default();
    for cases in jobs(cases) {
        let job = Job::Hard { cases: &cases };
        let text = held(qemu::run(processor, &image, Some(&job)));
        let report = held(EmulatorReport::parse(&text));
        whole.played.extend(report.played);
        whole.samples.extend(report.samples);
    }
    whole
}

/// The smallest and the largest number of instructions per sample, for each set of properties on which it may depend.
fn extremes(cases: &[Prepared], samples: &[Cost]) -> BTreeMap<String, (u32, u32, Vec<String>)> {
    let mut extremes = BTreeMap::new();
    for case in cases {
        for way in [report::SYNTHESIS, report::FILTER] {
            let name = format!("{way} {}", case.case.name);
            let cost = samples
                .iter()
                .find(|cost| cost.texture == name)
                .unwrap_or_else(|| panic!("{name} was not measured"));
            // The synthesis has one phase, and the filter on its own has six.
            let phases = if way == report::SYNTHESIS { 1 } else { 6 };
            assert_eq!(cost.calls, phases * SAMPLES, "{name}");
            let found = extremes
                .entry(format!("{way}, {}", case.plan()))
                .or_insert((u32::MAX, 0, Vec::new()));
            found.0 = cost.fewest.min(found.0);
            found.1 = cost.most.max(found.1);
            found.2.push(format!("{name}: {} to {}", cost.fewest, cost.most));
        }
    }
    extremes
}

fn every_hard_case(processor: Processor) {
    let cases: Vec<_> = suite(Length::Full).into_iter().map(Prepared::new).collect();
    assert!(cases.len() > 20, "{} cases", cases.len());
    let found = play(processor, &cases);
    let extremes = extremes(&cases, &found.samples);
    for (plan, (fewest, most, cases)) in &extremes {
        assert_eq!(fewest, most, "{plan} on {}: {cases:#?}", processor.name());
    }
    let mut host = Vec::new();
    for case in &cases {
        let played = case.case().play::<Portable>(&mut |_, sample| sample());
        host.push(format!("{} {} {}", report::VECTOR, report::CORTEX_M, case.case.name));
        host.extend(lines(&[played.unwrap()]));
    }
    held(same_bits(processor, &found.played, &host));
}

#[test]
fn no_hard_case_changes_what_a_sample_costs_an_m4_or_what_it_plays() {
    every_hard_case(Processor::CortexM4);
}

#[test]
fn no_hard_case_changes_what_a_sample_costs_an_m7_or_what_it_plays() {
    every_hard_case(Processor::CortexM7);
}
