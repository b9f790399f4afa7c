//! Costs on emulated processors: the rows for the shipped structure in `host-tools/costs/costs.json`, compared with new
//! counts by the image's timer.

use host_tools::evaluation::frontier::costs::Costs as LookUps;
use kernel_vectors::job::Job;
use kernel_vectors::{COUNTED_ORDERS, counted_library};
use stylus_costs::{Core, Structure};
use tasks::compare::{Cost, EmulatorReport};
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
const SAMPLE_SLACK: u32 = 16;

/// Largest difference between an update's instructions and the table's count. Other parts are inlined here: an update
/// takes 41 instructions fewer on a Cortex-M4, and 40 fewer on an M7.
const UPDATE_SLACK: u32 = 64;

/// Permitted difference in addition to [`SAMPLE_SLACK`] or [`UPDATE_SLACK`], as a fraction of the table's count.
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
                (entry.sample.instructions, now.sample.fewest, SAMPLE_SLACK),
                (entry.sample.instructions, now.sample.most, SAMPLE_SLACK),
                (entry.update.instructions_least, now.update.fewest, UPDATE_SLACK),
                (entry.update.instructions_most, now.update.most, UPDATE_SLACK),
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
