//! The kernel, built for two processors and run on their emulations, compared with the kernel on the host. For the
//! cases of `stylus stress`, no input changes the cost of a sample either.
//!
//! If a needed program is missing, these tests fail and name the command that installs it. `cargo tasks setup` names
//! it, too.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use host_tools::evaluation::stress::cases::{Case, Length, suite};
use host_tools::evaluation::stress::models::library;
use kernel_vectors::job::{CAPACITY, Job, OVERHEAD_BYTES};
use kernel_vectors::{COST_BUDGETS, DIGESTED, HardCase, digest_library, report as keyword};
use model_format::Library;
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::scene::cost::FEED;
use tasks::compare::{self, EmulatorReport};
use tasks::qemu;
use tasks::qemu::Processor;

use crate::{held, image};

/// The reports of both images, each built and run once for all tests.
static REPORTS: [LazyLock<Result<EmulatorReport, String>>; 2] = [
    LazyLock::new(|| play(Processor::CortexM4)),
    LazyLock::new(|| play(Processor::CortexM7)),
];

fn play(processor: Processor) -> Result<EmulatorReport, String> {
    compare::play(processor).map_err(|error| format!("{error:#}"))
}

fn report(processor: Processor) -> &'static EmulatorReport {
    let index = match processor {
        Processor::CortexM4 => 0,
        Processor::CortexM7 => 1,
    };
    match &*REPORTS[index] {
        Ok(report) => report,
        Err(error) => panic!("{error:#}"),
    }
}

#[test]
fn both_processors_play_the_hosts_bits() {
    let host = compare::on_host();
    for processor in Processor::ALL {
        held(compare::same_bits(processor, &report(processor).played, &host));
    }
}

/// Plays the fixture's digest, which host, board and browser must also play.
#[test]
fn both_processors_play_the_digest_with_every_arithmetic() {
    let library = digest_library();
    let job = Job::Digest { library: &library };
    for processor in Processor::ALL {
        let text = held(qemu::run(processor, &image(processor), Some(&job)));
        for arithmetic in keyword::ARITHMETICS {
            let line = format!("{} {DIGESTED:08x} {arithmetic}", keyword::DIGEST);
            assert!(
                text.lines().any(|found| found == line),
                "{}: {line} is not in\n{text}",
                processor.name()
            );
        }
    }
}

#[test]
fn the_kernel_is_within_its_budget_and_a_sample_takes_the_same_instructions_whatever_the_data() {
    for processor in Processor::ALL {
        held(compare::costs_hold(processor, report(processor)));
    }
}

/// The largest budget of an update, which the test above holds.
#[test]
fn the_page_of_costs_says_what_an_update_takes_at_most() {
    let most = COST_BUDGETS
        .iter()
        .map(|own| own.update_budget_instructions)
        .max()
        .expect("some are measured");
    let words = format!("an update takes up to {} {:03} instructions", most / 1000, most % 1000);
    let page = include_str!("../../../../host-tools/manual/COSTS.md")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ");
    assert!(page.contains(&words), "{words}");
}

/// Compares a lattice with recorded snippets to a plain one, both of order 400 with four nodes.
#[test]
fn the_excitation_of_a_fed_voice_takes_an_update_what_the_model_says_and_a_sample_hardly_more() {
    /// Largest number of instructions by which a fed sample may exceed a plain one.
    const MOST_FED: u32 = 40;
    for processor in Processor::ALL {
        let report = report(processor);
        let most = |costs: &[compare::Cost], texture: &str| {
            costs
                .iter()
                .find(|cost| cost.texture == texture)
                .expect("it is measured")
                .most
        };
        let fed = "lattice, snippets";
        let more = most(&report.follows, fed) - most(&report.follows, "lattice");
        println!("{}: {more} more per update", processor.name());
        assert!(more <= FEED * UPDATE_INTERVAL_SAMPLES, "{more}");
        let plain = most(&report.samples, "lattice");
        assert!(most(&report.samples, fed) <= plain + MOST_FED);
    }
}

/// Two wanders of four lines take 1618 instructions per update on a Cortex-M4, 1544 on a Cortex-M7, and none per
/// sample.
#[test]
fn a_wander_costs_a_sample_nothing_and_an_update_at_most_900_instructions() {
    for processor in Processor::ALL {
        let report = report(processor);
        let more = |costs: &[compare::Cost]| {
            let textures = ["lattice, four lines", "lattice, four lines that wander"];
            let [steady, wandering] = textures.map(|texture| {
                costs
                    .iter()
                    .find(|cost| cost.texture == texture)
                    .expect("it is measured")
                    .most
            });
            wandering.abs_diff(steady)
        };
        println!("{}: {} more per update", processor.name(), more(&report.follows));
        assert!(more(&report.samples) <= 16);
        assert!(more(&report.follows) <= 2 * 900);
    }
}

/// Number of samples per phase, with seven phases per case. It suffices for many motions, and for a state at full scale
/// to have its effects.
const PHASE_SAMPLES: u32 = 60;

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
            samples: PHASE_SAMPLES,
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
fn play_hard(processor: Processor, cases: &[Prepared]) -> EmulatorReport {
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
fn extremes(cases: &[Prepared], samples: &[compare::Cost]) -> BTreeMap<String, (u32, u32, Vec<String>)> {
    let mut extremes = BTreeMap::new();
    for case in cases {
        for way in [keyword::SYNTHESIS, keyword::FILTER] {
            let name = format!("{way} {}", case.case.name);
            let cost = samples
                .iter()
                .find(|cost| cost.texture == name)
                .unwrap_or_else(|| panic!("{name} was not measured"));
            // The synthesis has one phase, and the filter on its own has six.
            let phases = if way == keyword::SYNTHESIS { 1 } else { 6 };
            assert_eq!(cost.calls, phases * PHASE_SAMPLES, "{name}");
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
    let found = play_hard(processor, &cases);
    let extremes = extremes(&cases, &found.samples);
    for (plan, (fewest, most, cases)) in &extremes {
        assert_eq!(fewest, most, "{plan} on {}: {cases:#?}", processor.name());
    }
    let mut host = Vec::new();
    for case in &cases {
        let played = case.case().play::<Portable>(&mut |_, sample| sample());
        host.push(format!("{} {} {}", keyword::VECTOR, keyword::CORTEX_M, case.case.name));
        host.extend(compare::lines(&[played.unwrap()]));
    }
    held(compare::same_bits(processor, &found.played, &host));
}

#[test]
fn no_hard_case_changes_what_a_sample_costs_an_m4_or_what_it_plays() {
    every_hard_case(Processor::CortexM4);
}

#[test]
fn no_hard_case_changes_what_a_sample_costs_an_m7_or_what_it_plays() {
    every_hard_case(Processor::CortexM7);
}
