//! The costs of a sample and of an update, by structure, number of nodes, order and processor.
//!
//! Every instruction of some calls is traced on emulated processors ([`qemu_tests`]); [`mca`] gives them their cycles.

use std::path::PathBuf;

use anyhow::{Context, Error, Result, anyhow};
use kernel_vectors::job::{Filter, Job};
use kernel_vectors::{
    COUNTED_ORDERS, COUNTED_SAMPLES, COUNTED_UPDATES, PEER_SAMPLES, counted_library,
};
use model_format::limits::MAX_ORDER;
use qemu_tests::count::{Call, Counter};
use qemu_tests::image::Image;
use serde::Serialize;
use stylus_costs::{Core, Costs, Entry, Origin, Peer, SampleCost, Structure, UpdateCost};

use crate::guest::{self, Processor};
use crate::toolchain::Toolchain;
use crate::{mca, qemu, workspace};

/// The file of the table.
pub fn path() -> PathBuf {
    workspace::root().join("host-tools/costs/costs.json")
}

/// Reads the table.
///
/// # Errors
/// There is no such file, or it is none.
pub fn read() -> Result<Costs> {
    let place = || path().display().to_string();
    let text = std::fs::read_to_string(path()).with_context(place)?;
    serde_json::from_str(&text).with_context(place)
}

/// The text of the file: one line for each entry and peer, so that a diff shows the changed ones.
///
/// # Panics
/// Never, because numbers and text always have a form in JSON.
pub fn to_text(costs: &Costs) -> String {
    fn json(value: &impl Serialize) -> String {
        serde_json::to_string(value).expect("numbers and text have a form in JSON")
    }
    fn lines<T: Serialize>(values: &[T]) -> String {
        let line = |value| format!("    {}", json(value));
        values.iter().map(line).collect::<Vec<_>>().join(",\n")
    }
    format!(
        "{{\n  \"rustc\": {},\n  \"qemu\": {},\n  \"llvm_mca\": {},\n  \"entries\": [\n{}\n  ],\n  \
         \"peers\": [\n{}\n  ]\n}}\n",
        json(&costs.rustc),
        json(&costs.qemu),
        json(&costs.llvm_mca),
        lines(&costs.entries),
        lines(&costs.peers),
    )
}

/// An image with its code, ready for a trace.
pub struct Guest {
    processor: Processor,
    file: PathBuf,
    image: Image,
}

/// An entry whose cycles are not modelled yet, with the calls that they are of.
pub struct Counted {
    /// The entry, with no cycles.
    pub entry: Entry,
    sample: Call,
    dearest_update: Call,
}

impl Counted {
    /// The entry with cycles of `processor`.
    fn modelled(self, processor: Processor) -> Result<Entry> {
        let mut entry = self.entry;
        entry.sample.cycles = mca::cycles(processor, &self.sample.path)?;
        entry.update.cycles = mca::cycles(processor, &self.dearest_update.path)?;
        Ok(entry)
    }
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

/// The place of the update among the counted functions of a structure; the other is the sample.
const UPDATE: usize = 0;

impl Guest {
    /// Builds the image for `processor`.
    ///
    /// # Errors
    /// There is no toolchain, or the build fails.
    pub fn build(toolchain: &Toolchain, processor: Processor) -> Result<Self> {
        let file = guest::build(toolchain, processor)?;
        let bytes = std::fs::read(&file)?;
        Ok(Self {
            processor,
            image: Image::parse(&bytes)?,
            file,
        })
    }

    /// All calls of `functions`, given by parts of their mangled names, while the image does `job`.
    fn calls(&self, functions: &[&str], job: &Job<'_>) -> Result<Vec<Call>> {
        let functions = functions.iter().map(|name| self.image.function(name));
        let functions: Vec<u32> = functions.collect::<std::result::Result<_, _>>()?;
        let mut counter = Counter::new(&self.image, &functions)?;
        qemu::trace(self.processor, &self.file, job, |address| {
            counter.take(address)
        })?;
        Ok(counter.end()?)
    }

    fn wrong(&self, what: &str, problem: &str) -> Error {
        anyhow!("{}, {what}: {problem}", self.processor.name())
    }

    /// The instructions of `structure` at `orders`, on one node and on four.
    ///
    /// # Errors
    /// QEMU is missing, the image fails, or samples differ in cost.
    pub fn count(&self, structure: Structure, orders: &[usize]) -> Result<Vec<Counted>> {
        let subject = subject(structure);
        let library = counted_library(orders);
        let job = Job::Count {
            filter: subject.filter,
            updates: COUNTED_UPDATES,
            library: &library,
        };
        let calls = self.calls(&[subject.update, subject.sample], &job)?;
        let nodes = [1, 4].into_iter();
        let textures = nodes.flat_map(|nodes| orders.iter().map(move |&order| (nodes, order)));
        let each = (COUNTED_UPDATES * (1 + COUNTED_SAMPLES)) as usize;
        if calls.len() != 2 * orders.len() * each {
            let problem = format!("{} calls for {} textures", calls.len(), 2 * orders.len());
            return Err(self.wrong(structure.name(), &problem));
        }
        textures
            .zip(calls.chunks(each))
            .map(|((nodes, order), calls)| {
                let what = || format!("{}, order {order}, nodes {nodes}", structure.name());
                let costs = costs(calls).map_err(|problem| self.wrong(&what(), &problem))?;
                let (sample, cheapest, dearest) = costs;
                Ok(Counted {
                    entry: Entry {
                        structure,
                        nodes,
                        core: core(self.processor),
                        order: order as u32,
                        sample: SampleCost {
                            instructions: sample.instructions(),
                            cycles: 0,
                        },
                        update: UpdateCost {
                            instructions_least: cheapest,
                            instructions_most: dearest.instructions(),
                            cycles: 0,
                        },
                    },
                    sample: sample.clone(),
                    dearest_update: dearest.clone(),
                })
            })
            .collect()
    }

    /// The dearest call of each filter of order 400 without the excitation and level of the product, by name.
    ///
    /// # Errors
    /// QEMU is missing or the image fails.
    pub fn count_peers(&self) -> Result<Vec<(&'static str, Call)>> {
        let calls = self.calls(&ALONE.map(|(function, _)| function), &Job::Peers)?;
        let dearest = |(function, &(_, name)): (usize, &(_, &'static str))| {
            let calls = calls.iter().filter(|call| call.function == function);
            let count = calls.clone().count();
            match calls.max_by_key(|call| call.instructions()) {
                Some(dearest) if count == PEER_SAMPLES as usize => Ok((name, dearest.clone())),
                _ => {
                    let problem = format!("{count} calls instead of {PEER_SAMPLES}");
                    Err(self.wrong(name, &problem))
                }
            }
        };
        ALONE.iter().enumerate().map(dearest).collect()
    }
}

/// Filters that the image runs without excitation and level: a part of the function's mangled name, and the filter.
const ALONE: [(&str, &str); 6] = [
    (
        "5peers13lattice_alone",
        "stylus: normalised lattice, 32 bits",
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

/// The work of a call of a library's filter.
const FILTER_ALONE: &str = "filter";

/// The order of all peers.
const HIGHEST_ORDER: u32 = MAX_ORDER as u32;

/// The calls of one texture: a sample, the instructions of the cheapest update, and the dearest update.
fn costs(calls: &[Call]) -> std::result::Result<(&Call, u32, &Call), String> {
    let (updates, samples): (Vec<&Call>, Vec<&Call>) =
        calls.iter().partition(|call| call.function == UPDATE);
    let (Some(&first), true) = (samples.first(), updates.len() == COUNTED_UPDATES as usize) else {
        return Err(format!(
            "{} samples, and {} updates instead of {COUNTED_UPDATES}",
            samples.len(),
            updates.len()
        ));
    };
    if let Some(other) = samples.iter().find(|call| call.path != first.path) {
        let [first, other] = [first, other].map(Call::instructions);
        return Err(format!("samples differ: {first} and {other} instructions"));
    }
    if first.path.iter().any(|one| one.depends_on_data) {
        return Err("a sample divides, in a time that depends on the data".to_owned());
    }
    let cheapest = updates.iter().map(|call| call.instructions()).min();
    let dearest = updates.iter().max_by_key(|call| call.instructions());
    Ok((
        first,
        cheapest.unwrap_or_default(),
        dearest.copied().unwrap_or(first),
    ))
}

/// Counts everything, and reports each finished structure to `progress`.
///
/// # Errors
/// See [`Guest::count`] and [`mca::cycles`].
pub fn count(
    toolchain: &Toolchain,
    mut progress: impl FnMut(Processor, Structure),
) -> Result<Costs> {
    // Without it, minutes of counting would be lost.
    let llvm_mca = mca::version()?;
    let guests = [
        Guest::build(toolchain, Processor::CortexM4)?,
        Guest::build(toolchain, Processor::CortexM7)?,
    ];
    let mut entries = Vec::new();
    for guest in &guests {
        for structure in Structure::ALL {
            for counted in guest.count(structure, &COUNTED_ORDERS)? {
                entries.push(counted.modelled(guest.processor)?);
            }
            progress(guest.processor, structure);
        }
    }
    let [m4, m7] = guests.each_ref().map(Guest::count_peers);
    let mut others = Vec::new();
    for ((name, m4), (_, m7)) in m4?.into_iter().zip(m7?) {
        others.push(Peer {
            name: name.to_owned(),
            origin: Origin::Measured,
            includes: FILTER_ALONE.to_owned(),
            order: HIGHEST_ORDER,
            instructions: m4.instructions(),
            cortex_m4_cycles: Some(mca::cycles(Processor::CortexM4, &m4.path)?),
            cortex_m7_cycles: Some(mca::cycles(Processor::CortexM7, &m7.path)?),
        });
    }
    let peers = peers(&entries, others);
    Ok(Costs {
        rustc: compiler(toolchain)?,
        qemu: qemu::version()?,
        llvm_mca,
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

/// CMSIS-DSP's filters at 400 taps, the fastest build of each that was found: name, and instructions
/// per sample. They are references, built by hand and counted by the same rules on the same emulator, because
/// the library is C and not part of this build.
///
/// The sections and the blocks are of its sources at v1.17.1-16-gec1bb752: GCC 12.2.1 with `ARM_MATH_LOOPUNROLL` at -O2
/// (lattice) and -O3 (FIR, blocks of sections), Clang 14 at -O2 without it (one sample of sections).
const CMSIS_DSP: [(&str, u32); 11] = [
    ("FIR, q31", 2514),
    ("FIR, fast q31", 2564),
    ("FIR, q15", 1884),
    ("FIR, fast q15", 1725),
    ("FIR, f32", 3031),
    ("all-pole lattice, q31, two multipliers", 7096),
    ("all-pole lattice, f32, two multipliers", 5192),
    ("200 second-order sections, q31", 11019),
    ("FIR, q31, in blocks of 10", 1124),
    (
        "all-pole lattice, q31, two multipliers, in blocks of 10",
        5972,
    ),
    ("200 second-order sections, q31, in blocks of 10", 4003),
];

/// The product's filters at the highest order, then `others`, then CMSIS-DSP's.
fn peers(entries: &[Entry], others: Vec<Peer>) -> Vec<Peer> {
    // A sample takes the same over four nodes and over one.
    let of = |core| {
        let is_wanted = move |entry: &&Entry| {
            (entry.core, entry.order, entry.nodes) == (core, HIGHEST_ORDER, 4)
        };
        entries.iter().filter(is_wanted)
    };
    let ours = of(Core::M4).zip(of(Core::M7)).map(|(m4, m7)| Peer {
        name: format!("stylus: {}", m4.structure.name()),
        origin: Origin::Measured,
        includes: "filter, Gaussian excitation, level".to_owned(),
        order: m4.order,
        instructions: m4.sample.instructions,
        cortex_m4_cycles: Some(m4.sample.cycles),
        cortex_m7_cycles: Some(m7.sample.cycles),
    });
    let theirs = CMSIS_DSP.iter().map(|&(name, instructions)| Peer {
        name: format!("CMSIS-DSP: {name}"),
        origin: Origin::Reference,
        includes: FILTER_ALONE.to_owned(),
        order: HIGHEST_ORDER,
        instructions,
        cortex_m4_cycles: None,
        cortex_m7_cycles: None,
    });
    ours.chain(others).chain(theirs).collect()
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use qemu_tests::thumb::Instruction;

    use super::*;

    fn call(function: usize, instructions: u32) -> Call {
        let nop = Instruction {
            end: 2,
            text: "nop".to_owned(),
            is_call: false,
            depends_on_data: false,
        };
        let nop = Rc::new(nop);
        let path = (0..instructions).map(|_| nop.clone()).collect();
        Call { function, path }
    }

    fn calls() -> Vec<Call> {
        let mut calls = Vec::new();
        for update in 0..COUNTED_UPDATES {
            calls.push(call(UPDATE, 100 + update));
            calls.extend((0..COUNTED_SAMPLES).map(|_| call(1, 50)));
        }
        calls
    }

    #[test]
    fn an_update_goes_from_the_cheapest_to_the_dearest_and_a_sample_is_one_figure() {
        let calls = calls();
        let (sample, cheapest, dearest) = costs(&calls).unwrap();
        let found = (sample.instructions(), cheapest, dearest.instructions());
        assert_eq!(found, (50, 100, 100 + COUNTED_UPDATES - 1));
    }

    #[test]
    fn samples_that_differ_or_divide_and_updates_that_are_missing_are_refused() {
        let refused = |change: fn(&mut Vec<Call>)| {
            let mut calls = calls();
            change(&mut calls);
            costs(&calls).is_err()
        };
        assert!(!refused(|_| ()));
        assert!(refused(|calls| drop(calls[7].path.pop())));
        assert!(refused(|calls| {
            for call in calls.iter_mut().filter(|call| call.function != UPDATE) {
                Rc::make_mut(&mut call.path[3]).depends_on_data = true;
            }
        }));
        assert!(refused(|calls| drop(calls.remove(0))));
        assert!(refused(Vec::clear));
    }

    #[test]
    fn the_table_is_read_as_it_was_written_one_entry_a_line() {
        let table = read().unwrap();
        let text = to_text(&table);
        assert_eq!(serde_json::from_str::<Costs>(&text).unwrap(), table);
        assert_eq!(
            text.lines().count(),
            9 + table.entries.len() + table.peers.len()
        );
    }
}
