//! Costs on emulated processors. The rows for the shipped structure in `host-tools/costs/costs.json` are compared with
//! new counts by the image's timer. For the cases of `stylus stress`, no input changes the cost of a sample, and every
//! processor plays the same bits as the host.

use std::collections::BTreeMap;

use host_tools::evaluation::frontier::costs::Costs as LookUps;
use host_tools::evaluation::stress::cases::{Case, Length, suite};
use host_tools::evaluation::stress::models::library;
use kernel_vectors::job::{CAPACITY, Job, OVERHEAD_BYTES};
use kernel_vectors::{COUNTED_ORDERS, HardCase, counted_library, report};
use model_format::Library;
use stylus_costs::{Core, Structure};
use stylus_kernel::arithmetic::Portable;
use tasks::compare::{Cost, EmulatorReport, lines, same_bits};
use tasks::qemu::{self, Processor};
use tasks::toolchain::Toolchain;

use crate::{held, image};

/// Orders between those of the table. Their number of stages is not a multiple of the stages in one turn of the
/// lattice's loop.
const ORDERS_BETWEEN: [usize; 4] = [21, 23, 41, 121];

/// Largest number of instructions by which a sample may exceed the look-up between two orders: the instructions of the
/// three stages that can remain, because a lattice processes four stages at a time.
const BETWEEN_INSTRUCTIONS: f64 = 40.0;

/// Largest difference between a sample's instructions and the table's count. The table's calls were traced; the timer
/// also counts a call and a return of the same code, which are 5 instructions.
const SAMPLE: u32 = 16;

/// Largest difference between an update's instructions and the table's count. Other parts are inlined here: an update
/// takes 41 instructions fewer on a Cortex-M4, and 40 fewer on an M7.
const UPDATE: u32 = 64;

/// Permitted difference in addition to [`SAMPLE`] or [`UPDATE`], as a fraction of the table's count.
const TOLERANCE: f64 = 0.01;

/// The structure in the image.
const SHIPPED: Structure = Structure::NormalisedLattice32;

/// A texture's order and number of nodes, and the costs of its samples and updates.
struct Counted {
    order: usize,
    nodes: u32,
    sample: Cost,
    update: Cost,
}

/// Counts the costs of textures of these orders, with one node and with four. Returns nothing if the compiler differs
/// from the table's.
fn counted(processor: Processor, orders: &[usize]) -> Vec<Counted> {
    let toolchain = held(Toolchain::find());
    let (here, there) = (held(toolchain.compiler()), &LookUps::measured().table().rustc);
    if &here != there {
        println!("this is rustc {here}, and the table was counted with {there}: no comparison");
        return Vec::new();
    }
    let library = counted_library(orders);
    let job = Job::Count { library: &library };
    let text = held(qemu::run(processor, &image(processor), Some(&job)));
    let report = held(EmulatorReport::parse(&text));
    assert_eq!(report.samples.len(), 2 * orders.len());
    let nodes = [1, 4].into_iter();
    nodes
        .flat_map(|nodes| orders.iter().map(move |&order| (order, nodes)))
        .zip(report.samples.into_iter().zip(report.follows))
        .map(|((order, nodes), (sample, update))| Counted {
            order,
            nodes,
            sample,
            update,
        })
        .collect()
}

#[test]
fn what_is_counted_now_of_the_shipped_lattice_is_what_the_table_says() {
    let table = LookUps::measured().table();
    let mut wrong = Vec::new();
    for (processor, core) in Processor::ALL.into_iter().zip([Core::M4, Core::M7]) {
        for now in counted(processor, &COUNTED_ORDERS) {
            let entry = table
                .entry(SHIPPED, now.nodes, core, now.order as u32)
                .expect("the table has all orders that are counted");
            for (figure, counted, apart) in [
                (entry.sample.instructions, now.sample.fewest, SAMPLE),
                (entry.sample.instructions, now.sample.most, SAMPLE),
                (entry.update.instructions_least, now.update.fewest, UPDATE),
                (entry.update.instructions_most, now.update.most, UPDATE),
            ] {
                let (order, nodes) = (now.order, now.nodes);
                let told = format!("{core}, order {order}, nodes {nodes}: {figure}, now {counted}");
                println!("{told}");
                let allowed = f64::from(apart) + TOLERANCE * f64::from(figure);
                if f64::from(figure.abs_diff(counted)) > allowed {
                    wrong.push(told);
                }
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "host-tools/manual/COSTS.md says otherwise: {wrong:#?}"
    );
}

#[test]
fn between_two_orders_no_less_is_looked_up_than_what_is_counted_but_for_a_few_instructions() {
    for now in counted(Processor::CortexM4, &ORDERS_BETWEEN) {
        let cost = LookUps::measured().at(SHIPPED, now.nodes as usize, Core::M4, now.order);
        let looked_up = cost.expect("the table has orders around it").sample.instructions;
        assert!(
            f64::from(now.sample.most) <= looked_up + BETWEEN_INSTRUCTIONS,
            "the look-up gives {looked_up:.0} instructions, and a sample takes {:?}",
            now.sample
        );
    }
}

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
