//! Tables of `host-tools/costs/costs.json`, the counts of `cargo tasks costs`.

use stylus_costs::{Core, Costs, Entry, Origin, Peer, Structure};

use super::markdown::{grouped, range, table};

/// Nodes around a motion on a grid.
const NODES: u32 = 4;

/// The structures that an image has.
const SHIPPED: [Structure; 3] = [
    Structure::NormalisedLattice32,
    Structure::DirectForm32,
    Structure::DirectForm16,
];

/// Filters at order 400 on a Cortex-M4, ours and others'.
pub fn filters(costs: &Costs) -> String {
    let row = |peer: &Peer| {
        let origin = match peer.origin {
            Origin::Measured => "",
            Origin::Reference => " (reference, not counted here)",
        };
        [
            format!("{}{origin}", peer.name),
            peer.includes.clone(),
            grouped(peer.instructions.into()),
            modelled(peer.cortex_m4_cycles),
            modelled(peer.cortex_m7_cycles),
        ]
    };
    table(
        [
            "filter",
            "the call includes",
            "instructions",
            "cycles, Cortex-M4",
            "cycles, Cortex-M7",
        ],
        costs.peers.iter().map(row),
    )
}

/// Cycles by llvm-mca, or a dash where there are none.
fn modelled(cycles: Option<u32>) -> String {
    cycles.map_or_else(|| "–".to_owned(), |cycles| grouped(cycles.into()))
}

/// Instructions and cycles per sample of each structure at each order, on a Cortex-M4 and four nodes.
pub fn samples_by_order(costs: &Costs) -> String {
    let header = [
        "structure",
        "order",
        "instructions",
        "cycles, Cortex-M4",
        "cycles, Cortex-M7",
        "instructions per update",
    ];
    let counted = Structure::ALL.into_iter().flat_map(|structure| {
        let is_wanted = move |entry: &&Entry| {
            (entry.structure, entry.core, entry.nodes) == (structure, Core::M4, NODES)
        };
        costs.entries.iter().filter(is_wanted)
    });
    let rows = counted.map(|entry| {
        let shipped = if SHIPPED.contains(&entry.structure) {
            ""
        } else {
            " (not shipped)"
        };
        let (sample, update) = (entry.sample, entry.update);
        let m7 = costs.entry(entry.structure, NODES, Core::M7, entry.order);
        [
            format!("{}{shipped}", entry.structure.name()),
            entry.order.to_string(),
            grouped(sample.instructions.into()),
            grouped(sample.cycles.into()),
            modelled(m7.map(|m7| m7.sample.cycles)),
            range(
                update.instructions_least.into(),
                update.instructions_most.into(),
            ),
        ]
    });
    table(header, rows)
}
