//! What a sample and an update cost, by structure, number of nodes, order and processor: every instruction of some calls
//! is traced on emulated processors and given its cycles; see [`qemu_tests`].

use std::fmt::Write;
use std::path::PathBuf;

use kernel_vectors::job::{Filter, Job};
use kernel_vectors::{COUNTED_ORDERS, COUNTED_SAMPLES, COUNTED_UPDATES, counted_library};
use qemu_tests::costs::{Core, Costs, Entry, Origin, Peer, SampleCost, Structure, UpdateCost};
use qemu_tests::count::{Call, Counter};
use qemu_tests::image::Image;

use crate::error::{Error, Result};
use crate::guest::{self, Processor};
use crate::toolchain::Toolchain;
use crate::{qemu, workspace};

/// The file of the table.
pub fn path() -> PathBuf {
    workspace::root().join("tests/qemu/costs.json")
}

/// An image with its code, ready to be traced.
pub struct Guest {
    processor: Processor,
    file: PathBuf,
    image: Image,
}

/// What the image is asked to play for a structure, and the functions that do it: parts of their mangled names.
struct Subject {
    filter: Filter,
    stored: model_format::Structure,
    update: &'static str,
    sample: &'static str,
}

fn subject(structure: Structure) -> Subject {
    use model_format::Structure::{DirectForm16, DirectForm32, NormalisedLattice};
    let product = |stored| Subject {
        filter: Filter::Product,
        stored,
        update: "7counted6update",
        sample: "7counted6sample",
    };
    match structure {
        Structure::NormalisedLattice32 => product(NormalisedLattice),
        Structure::DirectForm32 => product(DirectForm32),
        Structure::DirectForm16 => product(DirectForm16),
        Structure::NormalisedLattice16 => Subject {
            filter: Filter::Normalised16,
            stored: NormalisedLattice,
            update: "7counted19normalised16_update",
            sample: "7counted19normalised16_sample",
        },
        Structure::TwoMultiplierLattice32 => Subject {
            filter: Filter::TwoMultiplier,
            stored: NormalisedLattice,
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

    /// What `structure` costs at `orders`, on one node and on four.
    ///
    /// # Errors
    /// QEMU is missing, the image fails, an instruction's time is not known, or samples differ in what they cost.
    pub fn count(&self, structure: Structure, orders: &[usize]) -> Result<Vec<Entry>> {
        let subject = subject(structure);
        let library = counted_library(subject.stored, orders);
        let job = Job::Count {
            filter: subject.filter,
            library: &library,
        };
        let functions = [
            self.image.function(subject.update)?,
            self.image.function(subject.sample)?,
        ];
        let mut counter = Counter::new(&self.image, &functions)?;
        qemu::trace(self.processor, &self.file, &job, |address| {
            counter.take(address)
        })?;
        let calls = counter.end()?;
        let textures = [1, 4]
            .into_iter()
            .flat_map(|nodes| orders.iter().map(move |&order| (nodes, order)));
        let textures: Vec<(u32, usize)> = textures.collect();
        let calls_each = (COUNTED_UPDATES * (1 + COUNTED_SAMPLES)) as usize;
        let wrong = |order: usize, nodes: u32, problem: String| Error::Calls {
            processor: self.processor.name(),
            what: format!("{}, order {order}, nodes {nodes}", structure.name()),
            problem,
        };
        if calls.len() != textures.len() * calls_each {
            let problem = format!("{} calls for {} textures", calls.len(), textures.len());
            return Err(wrong(0, 0, problem));
        }
        textures
            .into_iter()
            .zip(calls.chunks(calls_each))
            .map(|((nodes, order), calls)| {
                let (sample, update) =
                    costs(calls).map_err(|problem| wrong(order, nodes, problem))?;
                Ok(Entry {
                    structure,
                    nodes,
                    core: core(self.processor),
                    order: order as u32,
                    sample,
                    update,
                })
            })
            .collect()
    }
}

/// What the calls of one texture cost: function 0 is the update, 1 the sample.
fn costs(calls: &[Call]) -> std::result::Result<(SampleCost, UpdateCost), String> {
    let (updates, samples): (Vec<Call>, Vec<Call>) =
        calls.iter().partition(|call| call.function == 0);
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
    let sample = SampleCost {
        instructions: first.instructions,
        best_cycles: first.cycles.best,
        worst_cycles: first.cycles.worst,
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

/// Counts everything, telling `progress` what is done.
///
/// # Errors
/// See [`Guest::count`].
pub fn count(
    toolchain: &Toolchain,
    mut progress: impl FnMut(Processor, Structure),
) -> Result<Costs> {
    let mut entries = Vec::new();
    for processor in Processor::ALL {
        let guest = Guest::build(toolchain, processor)?;
        for structure in Structure::ALL {
            entries.extend(guest.count(structure, &COUNTED_ORDERS)?);
            progress(processor, structure);
        }
    }
    let peers = peers(&entries);
    Ok(Costs {
        rustc: compiler(toolchain)?,
        qemu: qemu::version()?,
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

/// CMSIS-DSP's filters at 400 taps, one sample a call, the fastest build of each, counted by the same rules on the same
/// emulator: what, instructions, cycles at best and at worst. They are references: the library is C, and not part of this build.
const CMSIS_DSP: [(&str, u32, u32, u32); 7] = [
    ("FIR, q31", 2514, 3217, 4422),
    ("FIR, fast q31", 2564, 3908, 4825),
    ("FIR, q15", 1884, 2496, 3376),
    ("FIR, fast q15", 1725, 2339, 3213),
    ("FIR, f32", 3031, 3997, 5268),
    ("all-pole lattice, q31, two multipliers", 7096, 8536, 10161),
    ("all-pole lattice, f32, two multipliers", 5192, 7084, 8320),
];

/// Ours at the highest order on a Cortex-M4, and CMSIS-DSP's.
fn peers(entries: &[Entry]) -> Vec<Peer> {
    let highest = COUNTED_ORDERS.iter().max().map_or(0, |&order| order as u32);
    let ours = entries.iter().filter(|entry| {
        // Four nodes or one are the same samples to a lattice.
        let is_lattice = !matches!(
            entry.structure,
            Structure::DirectForm16 | Structure::DirectForm32
        );
        entry.core == Core::M4 && entry.order == highest && !(is_lattice && entry.nodes == 1)
    });
    let ours = ours.map(|entry| Peer {
        name: match (entry.structure, entry.nodes) {
            (Structure::DirectForm16 | Structure::DirectForm32, 1) => {
                format!("stylus: {}, one node", entry.structure.name())
            }
            (Structure::DirectForm16 | Structure::DirectForm32, _) => {
                format!(
                    "stylus: {}, interpolated from four nodes",
                    entry.structure.name()
                )
            }
            _ => format!("stylus: {}", entry.structure.name()),
        },
        origin: Origin::Measured,
        includes: "filter, Gaussian excitation, level".to_owned(),
        order: entry.order,
        instructions: entry.sample.instructions,
        best_cycles: entry.sample.best_cycles,
        worst_cycles: entry.sample.worst_cycles,
    });
    let theirs = CMSIS_DSP
        .iter()
        .map(|&(name, instructions, best_cycles, worst_cycles)| Peer {
            name: format!("CMSIS-DSP: {name}"),
            origin: Origin::Reference,
            includes: "filter".to_owned(),
            order: 400,
            instructions,
            best_cycles,
            worst_cycles,
        });
    ours.chain(theirs).collect()
}

/// The table of entries, of each core its own columns, and the peers, as text.
pub fn table(costs: &Costs) -> String {
    let mut text = format!(
        "rustc {}, QEMU {}; cycles are the Cortex-M4's, modelled, best to worst; the worst bounds a Cortex-M7\n\n",
        costs.rustc, costs.qemu
    );
    let _ = writeln!(
        text,
        "{:<32} {:>5} {:>5}  {:>8} {:>15}  {:>8} {:>15}  {:>16}",
        "a sample", "nodes", "order", "M4", "cycles", "M7", "cycles", "an update, M4"
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
            "{:<32} {:>5} {:>5}  {:>8} {:>15}  {:>8} {:>15}  {:>16}",
            m4.structure.name(),
            m4.nodes,
            m4.order,
            m4.sample.instructions,
            cycles(m4.sample),
            m7.sample.instructions,
            cycles(m7.sample),
            update,
        );
    }
    let _ = writeln!(
        text,
        "\n{:<58} {:>12} {:>7} {:>7}  what the call does",
        "at order 400 on a Cortex-M4, one sample a call", "instructions", "best", "worst",
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
        let (sample, update) = costs(&calls()).unwrap();
        assert_eq!(
            (sample.instructions, sample.best_cycles, sample.worst_cycles),
            (50, 50, 100)
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
            costs(&calls).is_err()
        };
        assert!(refused(|calls| calls[7].instructions += 1));
        assert!(refused(|calls| calls[7].cycles.worst += 1));
        assert!(refused(|calls| {
            let samples = calls.iter_mut().filter(|call| call.function == 1);
            samples.for_each(|call| call.data_dependent = 1);
        }));
        assert!(refused(|calls| drop(calls.remove(0))));
        assert!(refused(Vec::clear));
    }
}
