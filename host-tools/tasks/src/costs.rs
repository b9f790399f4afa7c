//! The costs of a sample and of an update, by structure, number of nodes, order and processor.
//!
//! Every instruction of some calls is traced on emulated processors and takes the cycles of the manual; see
//! [`qemu_tests`].

use std::collections::BTreeSet;
use std::fmt::Write;
use std::ops::RangeInclusive;
use std::path::PathBuf;

use kernel_vectors::job::{Filter, Job};
use kernel_vectors::{
    COUNTED_ORDERS, COUNTED_SAMPLES, COUNTED_UPDATES, PEER_SAMPLES, counted_library,
};
use model_format::limits::MAX_ORDER;
use qemu_tests::count::{Alignment, Call, Counter};
use qemu_tests::image::Image;
use stylus_costs::{Core, Costs, Entry, Origin, Peer, SampleCost, Structure, UpdateCost};

use crate::error::{Error, Result};
use crate::guest::{self, Processor};
use crate::toolchain::Toolchain;
use crate::{mca, qemu, workspace};

/// The file of the table.
pub fn path() -> PathBuf {
    workspace::root().join("host-tools/costs/costs.json")
}

/// An image with its code, ready for a trace.
pub struct Guest {
    processor: Processor,
    file: PathBuf,
    image: Image,
}

/// The image's job for a structure, and the functions that do it, by parts of their mangled names.
struct Subject {
    filter: Filter,
    update: &'static str,
    sample: &'static str,
}

fn subject(structure: Structure) -> Subject {
    match structure {
        Structure::NormalisedLattice32 => Subject {
            filter: Filter::Product,
            update: "7counted6update",
            sample: "7counted6sample",
        },
        // Both are played in 32 bits.
        Structure::DirectForm32 | Structure::DirectForm16 => Subject {
            filter: Filter::Direct,
            update: "7counted13direct_update",
            sample: "7counted13direct_sample",
        },
        Structure::NormalisedLattice16 => Subject {
            filter: Filter::Normalised16,
            update: "7counted19normalised16_update",
            sample: "7counted19normalised16_sample",
        },
        Structure::TwoMultiplierLattice32 => Subject {
            filter: Filter::TwoMultiplier,
            update: "7counted21two_multiplier_update",
            sample: "7counted21two_multiplier_sample",
        },
    }
}

const fn core(processor: Processor) -> Core {
    match processor {
        Processor::CortexM4 => Core::M4,
        Processor::CortexM7 => Core::M7,
    }
}

impl Guest {
    /// Builds the image for `processor`.
    ///
    /// # Errors
    /// There is no toolchain, or the build fails.
    pub fn build(toolchain: &Toolchain, processor: Processor) -> Result<Self> {
        let file = guest::build(toolchain, processor)?;
        let bytes = std::fs::read(&file).map_err(|_| Error::NoImage(file.clone()))?;
        Ok(Self {
            processor,
            image: Image::parse(&bytes)?,
            file,
        })
    }

    /// The costs of `structure` at `orders`, on one node and on four.
    ///
    /// # Errors
    /// QEMU is missing, the image fails, an instruction's time is not known, or samples differ in cost.
    pub fn count(&self, structure: Structure, orders: &[usize]) -> Result<Vec<Entry>> {
        let subject = subject(structure);
        let library = counted_library(orders);
        let job = |updates| Job::Count {
            filter: subject.filter,
            updates,
            library: &library,
        };
        let functions = [
            self.image.function(subject.update)?,
            self.image.function(subject.sample)?,
        ];
        let mut counter = Counter::new(&self.image, &functions)?;
        qemu::trace(
            self.processor,
            &self.file,
            &job(COUNTED_UPDATES),
            |address| counter.take(address),
        )?;
        let ranges = ranges(counter.executed(SAMPLE));
        let calls = counter.end()?;
        let mut alignment = Alignment::new(&self.image, functions[SAMPLE])?;
        qemu::trace_registers(self.processor, &self.file, &job(1), &ranges, |moment| {
            alignment.take(&moment)
        })?;
        let extra = alignment.end();

        let nodes = [1, 4].into_iter();
        let textures: Vec<(u32, usize)> = nodes
            .flat_map(|nodes| orders.iter().map(move |&order| (nodes, order)))
            .collect();
        let calls_each = (COUNTED_UPDATES * (1 + COUNTED_SAMPLES)) as usize;
        let extra_each = COUNTED_SAMPLES as usize;
        let wrong = |order: usize, nodes: u32, problem: String| Error::Calls {
            processor: self.processor.name(),
            what: format!("{}, order {order}, nodes {nodes}", structure.name()),
            problem,
        };
        if (calls.len(), extra.len()) != (textures.len() * calls_each, textures.len() * extra_each)
        {
            let (calls, samples, textures) = (calls.len(), extra.len(), textures.len());
            let problem = format!("{calls} calls, and {samples} samples, for {textures} textures");
            return Err(wrong(0, 0, problem));
        }
        let extra = extra.chunks(extra_each);
        textures
            .into_iter()
            .zip(calls.chunks(calls_each).zip(extra))
            .map(|((nodes, order), (calls, extra))| {
                let (sample, update) =
                    costs(calls, extra).map_err(|problem| wrong(order, nodes, problem))?;
                Ok(Entry {
                    structure,
                    nodes,
                    core: core(self.processor),
                    order: order as u32,
                    sample,
                    update,
                    modelled_cycles: None,
                })
            })
            .collect()
    }

    /// Cycles of a sample on a Cortex-M7 by [`mca`], in the order of [`Guest::count`].
    ///
    /// # Errors
    /// QEMU or llvm-mca is missing, the image fails, or llvm-mca does not know an instruction.
    pub fn model(&self, structure: Structure, orders: &[usize]) -> Result<Vec<u32>> {
        let subject = subject(structure);
        let library = counted_library(orders);
        let job = Job::Count {
            filter: subject.filter,
            updates: 1,
            library: &library,
        };
        let functions = [self.image.function(subject.sample)?];
        let mut counter = Counter::new(&self.image, &functions)?;
        qemu::trace(self.processor, &self.file, &job, |address| {
            counter.take(address)
        })?;
        // All samples of a texture execute the same instructions.
        let firsts = counter.paths(0).step_by(COUNTED_SAMPLES as usize);
        firsts.map(|path| mca::cycles(&path)).collect()
    }
}

/// The places of update and sample among the counted functions.
const UPDATE: usize = 0;
const SAMPLE: usize = 1;

/// The fewest ranges that hold `addresses` and no other functions.
fn ranges(addresses: &BTreeSet<u32>) -> Vec<RangeInclusive<u32>> {
    /// The largest gap within a range, bytes, such as a jump over a few instructions.
    const GAP_BYTES: u32 = 32;
    let mut ranges: Vec<RangeInclusive<u32>> = Vec::new();
    for &address in addresses {
        match ranges.last_mut() {
            Some(last) if address - last.end() <= GAP_BYTES => *last = *last.start()..=address,
            _ => ranges.push(address..=address),
        }
    }
    ranges
}

/// Filters that the image runs without excitation and level: a part of the function's mangled name, and the filter.
const ALONE: [(&str, &str); 7] = [
    (
        "5peers13lattice_alone",
        "stylus: normalised lattice, 32 bits",
    ),
    (
        "5peers14lattice_of_two",
        "stylus: normalised lattice, 32 bits, two samples in one pass",
    ),
    ("5peers12direct_alone", "stylus: direct form, 32 bits"),
    (
        "5peers10idsp_fixed",
        "idsp 0.23: 200 second-order sections, i32, 64-bit sums",
    ),
    (
        "5peers10idsp_float",
        "idsp 0.23: 200 second-order sections, f32",
    ),
    ("5peers12plain_direct", "plain Rust: direct form, f32"),
    (
        "5peers13plain_lattice",
        "plain Rust: two-multiplier lattice, f32",
    ),
];

impl Guest {
    /// The costs of filters of order 400, others' and ours, without the excitation and level of the product.
    ///
    /// # Errors
    /// QEMU is missing, the image fails, or an instruction's time is not known.
    pub fn count_peers(&self) -> Result<Vec<Peer>> {
        let functions: Vec<u32> = ALONE
            .iter()
            .map(|(name, _)| self.image.function(name))
            .collect::<std::result::Result<_, _>>()?;
        let mut counter = Counter::new(&self.image, &functions)?;
        qemu::trace(self.processor, &self.file, &Job::Peers, |address| {
            counter.take(address)
        })?;
        let calls = counter.end()?;
        let peer = |(function, &(_, name)): (usize, &(&str, &str))| {
            let calls: Vec<&Call> = calls
                .iter()
                .filter(|call| call.function == function)
                .collect();
            if calls.len() != PEER_SAMPLES as usize {
                return Err(Error::Calls {
                    processor: self.processor.name(),
                    what: name.to_owned(),
                    problem: format!("{} calls instead of {PEER_SAMPLES}", calls.len()),
                });
            }
            let most = |figure: fn(&Call) -> u32| calls.iter().map(|call| figure(call)).max();
            Ok(Peer {
                name: name.to_owned(),
                origin: Origin::Measured,
                includes: FILTER_ALONE.to_owned(),
                order: HIGHEST_ORDER,
                instructions: most(|call| call.instructions).unwrap_or_default(),
                best_cycles: most(|call| call.cycles.best).unwrap_or_default(),
                worst_cycles: most(|call| call.cycles.worst).unwrap_or_default(),
                cortex_m7_cycles: None,
            })
        };
        ALONE.iter().enumerate().map(peer).collect()
    }

    /// Cycles of the same filters on a Cortex-M7 by [`mca`], of this image, which is built for it.
    ///
    /// # Errors
    /// QEMU or llvm-mca is missing, the image fails, or llvm-mca does not know an instruction.
    pub fn model_peers(&self) -> Result<Vec<u32>> {
        let functions: Vec<u32> = ALONE
            .iter()
            .map(|(name, _)| self.image.function(name))
            .collect::<std::result::Result<_, _>>()?;
        let mut counter = Counter::new(&self.image, &functions)?;
        qemu::trace(self.processor, &self.file, &Job::Peers, |address| {
            counter.take(address)
        })?;
        let of = |function| {
            let path = counter.paths(function).next().unwrap_or_default();
            mca::cycles(&path)
        };
        (0..ALONE.len()).map(of).collect()
    }
}

/// The work of a call of a library's filter.
const FILTER_ALONE: &str = "filter";

/// The order of all peers.
const HIGHEST_ORDER: u32 = MAX_ORDER as u32;

/// The cost of the calls of one texture. `extra` has the cycles that successive samples take for unaligned accesses.
/// Its last value is left out, because it may include the code after that sample.
fn costs(calls: &[Call], extra: &[u32]) -> std::result::Result<(SampleCost, UpdateCost), String> {
    let (updates, samples): (Vec<Call>, Vec<Call>) =
        calls.iter().partition(|call| call.function == UPDATE);
    let (Some(&first), Some(&update)) = (samples.first(), updates.first()) else {
        return Err("there are no samples, or no updates".to_owned());
    };
    if updates.len() != COUNTED_UPDATES as usize {
        return Err(format!(
            "{} updates instead of {COUNTED_UPDATES}",
            updates.len()
        ));
    }
    if let Some(other) = samples.iter().find(|&&call| call != first) {
        return Err(format!("samples differ: {first:?} and {other:?}"));
    }
    if first.data_dependent > 0 {
        return Err(format!(
            "a sample has {} divisions, whose time depends on the data",
            first.data_dependent
        ));
    }
    let extra = &extra[..extra.len().saturating_sub(1)];
    let (Some(&least_extra), Some(&most_extra)) = (extra.iter().min(), extra.iter().max()) else {
        return Err("no accesses were followed".to_owned());
    };
    let sample = SampleCost {
        instructions: first.instructions,
        best_cycles: first.cycles.best + least_extra,
        worst_cycles: first.cycles.worst + most_extra,
    };
    let least =
        |figure: fn(&Call) -> u32| updates.iter().map(figure).min().unwrap_or(figure(&update));
    let most =
        |figure: fn(&Call) -> u32| updates.iter().map(figure).max().unwrap_or(figure(&update));
    let update = UpdateCost {
        instructions_least: least(|call| call.instructions),
        instructions_most: most(|call| call.instructions),
        best_cycles: least(|call| call.cycles.best),
        worst_cycles: most(|call| call.cycles.worst),
    };
    Ok((sample, update))
}

/// Counts everything, and reports each finished structure to `progress`.
///
/// # Errors
/// See [`Guest::count`].
pub fn count(
    toolchain: &Toolchain,
    mut progress: impl FnMut(Processor, Structure),
) -> Result<Costs> {
    // Without it, minutes of counting would be lost.
    let llvm_mca = mca::version()?;
    let (mut entries, mut others) = (Vec::new(), Vec::new());
    // The Cortex-M4 comes first: the Cortex-M7's figures are added to its peers.
    for processor in Processor::ALL {
        let guest = Guest::build(toolchain, processor)?;
        match processor {
            Processor::CortexM4 => others = guest.count_peers()?,
            Processor::CortexM7 => {
                for (peer, cycles) in others.iter_mut().zip(guest.model_peers()?) {
                    peer.cortex_m7_cycles = Some(cycles);
                }
            }
        }
        for structure in Structure::ALL {
            let mut counted = guest.count(structure, &COUNTED_ORDERS)?;
            if processor == Processor::CortexM7 {
                let modelled = guest.model(structure, &COUNTED_ORDERS)?;
                for (entry, cycles) in counted.iter_mut().zip(modelled) {
                    entry.modelled_cycles = Some(cycles);
                }
            }
            entries.extend(counted);
            progress(processor, structure);
        }
    }
    let peers = peers(&entries, others);
    Ok(Costs {
        rustc: compiler(toolchain)?,
        qemu: qemu::version()?,
        llvm_mca: Some(llvm_mca),
        entries,
        peers,
    })
}

/// The version of the compiler, without its name.
///
/// # Errors
/// It cannot be run.
pub fn compiler(toolchain: &Toolchain) -> Result<String> {
    let version = toolchain.compiler_version()?;
    Ok(version
        .strip_prefix("rustc ")
        .unwrap_or(&version)
        .to_owned())
}

/// CMSIS-DSP's filters at 400 taps, the fastest build of each that was found: name, and per sample instructions, cycles
/// at best and at worst. They are references, built by hand and counted by the same rules on the same emulator, because
/// the library is C and not part of this build.
///
/// The sections and the blocks are of its sources at v1.17.1-16-gec1bb752: GCC 12.2.1 with `ARM_MATH_LOOPUNROLL` at -O2
/// (lattice) and -O3 (FIR, blocks of sections), Clang 14 at -O2 without it (one sample of sections).
const CMSIS_DSP: [(&str, u32, u32, u32); 11] = [
    ("FIR, q31", 2514, 3217, 4422),
    ("FIR, fast q31", 2564, 3908, 4825),
    ("FIR, q15", 1884, 2496, 3376),
    ("FIR, fast q15", 1725, 2339, 3213),
    ("FIR, f32", 3031, 3997, 5268),
    ("all-pole lattice, q31, two multipliers", 7096, 8536, 10161),
    ("all-pole lattice, f32, two multipliers", 5192, 7084, 8320),
    ("200 second-order sections, q31", 11019, 15446, 16652),
    ("FIR, q31, in blocks of 10", 1124, 1472, 1763),
    (
        "all-pole lattice, q31, two multipliers, in blocks of 10",
        5972,
        7034,
        7664,
    ),
    (
        "200 second-order sections, q31, in blocks of 10",
        4003,
        5165,
        5625,
    ),
];

/// The modelled cycles of the same filter on a Cortex-M7.
fn m7_cycles(entries: &[Entry], m4: &Entry) -> Option<u32> {
    let of = |entry: &&Entry| {
        (entry.structure, entry.nodes, entry.core, entry.order)
            == (m4.structure, m4.nodes, Core::M7, m4.order)
    };
    entries.iter().find(of)?.modelled_cycles
}

/// The product's filters at the highest order on a Cortex-M4, then `others`, then CMSIS-DSP's.
fn peers(entries: &[Entry], others: Vec<Peer>) -> Vec<Peer> {
    // A sample takes the same over four nodes and over one.
    let ours = entries
        .iter()
        .filter(|entry| entry.core == Core::M4 && entry.order == HIGHEST_ORDER && entry.nodes == 4);
    let ours = ours.map(|entry| Peer {
        name: format!("stylus: {}", entry.structure.name()),
        origin: Origin::Measured,
        includes: "filter, Gaussian excitation, level".to_owned(),
        order: entry.order,
        instructions: entry.sample.instructions,
        best_cycles: entry.sample.best_cycles,
        worst_cycles: entry.sample.worst_cycles,
        cortex_m7_cycles: m7_cycles(entries, entry),
    });
    let theirs = CMSIS_DSP
        .iter()
        .map(|&(name, instructions, best_cycles, worst_cycles)| Peer {
            name: format!("CMSIS-DSP: {name}"),
            origin: Origin::Reference,
            includes: FILTER_ALONE.to_owned(),
            order: HIGHEST_ORDER,
            instructions,
            best_cycles,
            worst_cycles,
            cortex_m7_cycles: None,
        });
    ours.chain(others).chain(theirs).collect()
}

/// The entries as a table with columns for each core, and the peers, as text.
pub fn table(costs: &Costs) -> String {
    let mut text = format!(
        "rustc {}, QEMU {}; cycles are the Cortex-M4's, modelled, best to worst; the worst bounds a Cortex-M7, which \
         llvm-mca {} models\n\n",
        costs.rustc,
        costs.qemu,
        costs.llvm_mca.as_deref().unwrap_or("has not")
    );
    let _ = writeln!(
        text,
        "{:<32} {:>5} {:>5}  {:>8} {:>15}  {:>8} {:>15} {:>9}  {:>16}",
        "per sample",
        "nodes",
        "order",
        "M4",
        "cycles",
        "M7",
        "cycles",
        "llvm-mca",
        "per update, M4"
    );
    for m4 in costs.entries.iter().filter(|entry| entry.core == Core::M4) {
        let Some(m7) = costs.entry(m4.structure, m4.nodes, Core::M7, m4.order) else {
            continue;
        };
        let cycles =
            |sample: SampleCost| format!("{} to {}", sample.best_cycles, sample.worst_cycles);
        let update = format!(
            "{} to {}",
            m4.update.instructions_least, m4.update.instructions_most
        );
        let _ = writeln!(
            text,
            "{:<32} {:>5} {:>5}  {:>8} {:>15}  {:>8} {:>15} {:>9}  {:>16}",
            m4.structure.name(),
            m4.nodes,
            m4.order,
            m4.sample.instructions,
            cycles(m4.sample),
            m7.sample.instructions,
            cycles(m7.sample),
            m7.modelled_cycles.unwrap_or_default(),
            update,
        );
    }
    let _ = writeln!(
        text,
        "\n{:<58} {:>12} {:>7} {:>7}  work of the call",
        "at order 400 on a Cortex-M4, per sample", "instructions", "best", "worst",
    );
    for peer in &costs.peers {
        let origin = match peer.origin {
            Origin::Measured => "measured now",
            Origin::Reference => "reference",
        };
        let _ = writeln!(
            text,
            "{:<58} {:>12} {:>7} {:>7}  {} ({origin})",
            peer.name, peer.instructions, peer.best_cycles, peer.worst_cycles, peer.includes
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use qemu_tests::cortex_m4::Cycles;

    fn call(function: usize, instructions: u32) -> Call {
        Call {
            function,
            instructions,
            cycles: Cycles {
                best: instructions,
                worst: 2 * instructions,
            },
            data_dependent: 0,
        }
    }

    fn calls() -> Vec<Call> {
        let mut calls = Vec::new();
        for update in 0..COUNTED_UPDATES {
            calls.push(call(0, 100 + update));
            calls.extend((0..COUNTED_SAMPLES).map(|_| call(1, 50)));
        }
        calls
    }

    #[test]
    fn an_update_goes_from_the_cheapest_to_the_dearest_and_a_sample_is_one_figure() {
        // The last sample's accesses include those of the code after it.
        let (sample, update) = costs(&calls(), &[3, 1, 7, 99]).unwrap();
        assert_eq!(
            (sample.instructions, sample.best_cycles, sample.worst_cycles),
            (50, 51, 107)
        );
        let last = 100 + COUNTED_UPDATES - 1;
        assert_eq!(
            (update.instructions_least, update.instructions_most),
            (100, last)
        );
        assert_eq!((update.best_cycles, update.worst_cycles), (100, 2 * last));
    }

    #[test]
    fn samples_that_differ_or_divide_and_updates_that_are_missing_are_refused() {
        let refused = |change: fn(&mut Vec<Call>)| {
            let mut calls = calls();
            change(&mut calls);
            costs(&calls, &[0; 4]).is_err()
        };
        assert!(!refused(|_| ()));
        assert!(refused(|calls| calls[7].instructions += 1));
        assert!(refused(|calls| calls[7].cycles.worst += 1));
        assert!(refused(|calls| {
            let samples = calls.iter_mut().filter(|call| call.function == 1);
            samples.for_each(|call| call.data_dependent = 1);
        }));
        assert!(refused(|calls| {
            calls.remove(0);
        }));
        assert!(refused(Vec::clear));
        assert!(costs(&calls(), &[1]).is_err());
    }

    #[test]
    fn ranges_hold_all_addresses_and_no_far_ones() {
        let addresses = BTreeSet::from([0x100, 0x102, 0x106, 0x200, 0x21e, 0x1000]);
        assert_eq!(
            ranges(&addresses),
            [0x100..=0x106, 0x200..=0x21e, 0x1000..=0x1000]
        );
        assert_eq!(ranges(&BTreeSet::new()), []);
    }
}
